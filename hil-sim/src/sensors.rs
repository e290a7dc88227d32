//! Encoder and index as they see the true mirror.

use crate::motor::Sensors;
use crate::noise::{Noise, Source};
use std::f64::consts::TAU;

/// An encoder whose disc sits off its axis.
#[derive(Clone, Debug)]
pub struct Encoder {
    counts_per_radian: f64,
    eccentricity: f64,
    phase: f64,
    offset: f64,
    noise_counts: f64,
    noise: Noise,
}

impl Encoder {
    /// With a phase from `seed`.
    pub fn new(sensors: &Sensors, seed: u64) -> Self {
        let mut phase = Noise::new(seed, Source::EncoderPhase);
        let counts_per_radian = f64::from(sensors.encoder_counts_per_turn) / TAU;
        Self {
            counts_per_radian,
            eccentricity: sensors.encoder_eccentricity_deg.to_radians(),
            phase: phase.uniform() * TAU,
            offset: phase.uniform() * TAU,
            noise_counts: sensors.encoder_edge_noise_deg.to_radians() * counts_per_radian,
            noise: Noise::new(seed, Source::EncoderEdges),
        }
    }

    /// The count with the mirror at `angle`, radians, unwrapped.
    pub fn count(&mut self, angle: f64) -> i64 {
        let seen = angle + self.offset + self.eccentricity * (angle + self.phase).sin();
        let counts = seen * self.counts_per_radian;
        // Each passage of an edge has its own error, however often the counter is read near it.
        let edge = counts.round();
        let past = counts - edge - self.noise_counts * self.noise.normal_of(edge as i64);
        edge as i64 - i64::from(past < 0.0)
    }
}

/// The index pulse's jitter.
#[derive(Clone, Debug)]
pub struct Index {
    jitter_ns: f64,
    noise: Noise,
}

impl Index {
    /// With jitter from `seed`.
    pub fn new(sensors: &Sensors, seed: u64) -> Self {
        Self { jitter_ns: sensors.index_jitter_us * 1e3, noise: Noise::new(seed, Source::Index) }
    }

    /// By how many nanoseconds the next pulse is late.
    pub fn lateness(&mut self) -> f64 {
        self.jitter_ns * self.noise.normal()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motor::Motor;

    #[test]
    fn a_turn_has_all_counts_and_the_disc_is_off_by_its_eccentricity() {
        let mut encoder = Encoder::new(&Motor::reference().sensors, 4);
        let start = encoder.count(1.0);
        assert!((encoder.count(1.0 + TAU) - start - 2_000).abs() <= 1);
        let error = |encoder: &mut Encoder, angle: f64| {
            let seen = encoder.count(angle) as f64 + 0.5;
            seen / encoder.counts_per_radian - encoder.offset - angle
        };
        let samples: Vec<f64> = (0..20_000).map(|i| error(&mut encoder, f64::from(i) * 0.01)).collect();
        let (mut sine, mut cosine) = (0.0, 0.0);
        for (i, sample) in samples.iter().enumerate() {
            sine += sample * (i as f64 * 0.01).sin() / 10_000.0;
            cosine += sample * (i as f64 * 0.01).cos() / 10_000.0;
        }
        assert!((sine.hypot(cosine).to_degrees() - 0.05).abs() < 0.002);
    }
}
