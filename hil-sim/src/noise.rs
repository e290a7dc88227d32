//! Random numbers: one ChaCha stream a source, so that more noise from one leaves the others as they were.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Who draws.
#[derive(Clone, Copy, Debug)]
#[repr(u64)]
pub enum Source {
    /// Phases of ripple, cogging and imbalance.
    PlantPhases = 1,
    /// Phase of the encoder's eccentricity, and where its count starts.
    EncoderPhase,
    /// Encoder edges.
    EncoderEdges,
    /// The index.
    Index,
    /// Frame pulses.
    FramePulses,
    /// The projector's rate.
    ProjectorRate,
    /// Where the mirror stands and the projector is when the simulation starts.
    Start,
    /// Plane pulses.
    PlanePulses,
    /// How soon a projector answers a trigger.
    Trigger,
    /// Which bit of a mark arrives the other way.
    Video,
}

/// The stream of one source.
#[derive(Clone, Debug)]
pub struct Noise(ChaCha8Rng);

impl Noise {
    /// The stream of `source` in the world of `seed`.
    pub fn new(seed: u64, source: Source) -> Self {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        generator.set_stream(source as u64);
        Self(generator)
    }

    /// A standard normal deviate.
    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    /// Uniform, 0 ≤ result < 1.
    pub fn uniform(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// The standard normal deviate that belongs to `number`, whatever was drawn before.
    pub fn normal_of(&mut self, number: i64) -> f64 {
        // A block of ChaCha holds 16 words; each number has one of its own. A ziggurat seldom needs more than two words, and running on
        // into the next number's block then correlates nothing that matters.
        self.0.set_word_pos(u128::from(number.wrapping_add(1 << 40) as u64 & ((1 << 60) - 1)) * 16);
        self.normal()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_are_independent_and_numbers_repeat() {
        let mut edges = Noise::new(1, Source::EncoderEdges);
        let mut index = Noise::new(1, Source::Index);
        let (first, second) = (edges.normal_of(-5), edges.normal_of(6));
        assert_eq!(edges.normal_of(-5), first);
        assert_ne!(first, second);
        assert_ne!(index.normal_of(-5), first);
        let mean: f64 = (0..10_000).map(|i| edges.normal_of(i)).sum::<f64>() / 1e4;
        assert!(mean.abs() < 0.04, "{mean}");
    }
}
