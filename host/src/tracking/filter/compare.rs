//! Ways to predict a head, measured on heads that walk, nod and stand.

use super::Filter;
use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;
use std::time::Duration;

const SECONDS: f64 = 30.0;
const RATES_HZ: [f64; 3] = [30.0, 60.0, 240.0];
const AHEAD_S: [f64; 3] = [0.06, 0.1, 0.15];
const MOTIONS: [Motion; 3] = [walking, nodding, standing];

/// Metres at a second.
type Motion = fn(f64) -> DVec3;

/// From 0 to 1 within a second, with the least jerk.
fn reach(progress: f64) -> f64 {
    let x = progress.clamp(0.0, 1.0);
    x.powi(3) * (10.0 - 15.0 * x + 6.0 * x * x)
}

/// A walk of 6 s one way and 6 s back, its speed 0.9 rad/s tanh(4 sin(τ t / 12)); by its integral on a fine grid.
fn walking(t: f64) -> DVec3 {
    const STEPS: usize = 200;
    let speed = |t: f64| (4.0 * (TAU * t / 12.0).sin()).tanh();
    let step = t / STEPS as f64;
    let azimuth = 0.9 * step * (0..STEPS).map(|index| speed((index as f64 + 0.5) * step)).sum::<f64>();
    let distance = 0.9 + 0.15 * (TAU * t / 7.0).sin() + 0.02 * (TAU * 0.9 * t).sin() * speed(t).abs();
    let height = 0.35 + 0.02 * (TAU * 1.8 * t).sin() * speed(t).abs();
    DVec3::new(distance * azimuth.sin(), height, distance * azimuth.cos())
}

/// Two nods of 20 degrees, a look of 40 degrees aside and back, up by 0.3 m and down again, every 6 s; eyes 0.1 m above and 0.12 m
/// before the neck.
fn nodding(t: f64) -> DVec3 {
    let t = t % 6.0;
    let pitch = 20f64.to_radians() * if t < 2.0 { (TAU * t).sin() } else { 0.0 };
    let yaw = 40f64.to_radians() * (reach((t - 2.5) / 0.5) - reach((t - 3.5) / 0.5));
    let up = 0.3 * (reach((t - 4.2) / 0.7) - reach((t - 5.2) / 0.7));
    let (sin, cos) = pitch.sin_cos();
    let (height, forward) = (0.1 * cos - 0.12 * sin, 0.12 * cos + 0.1 * sin);
    DVec3::new(forward * yaw.sin(), height + up, forward * yaw.cos())
}

fn standing(t: f64) -> DVec3 {
    DVec3::new(0.004 * (TAU * 0.31 * t).sin(), 0.001 * (TAU * 0.7 * t).sin(), 0.006 * (TAU * 0.23 * t).sin())
}

/// A way: takes readings, tells a place ahead.
trait Way {
    fn take(&mut self, position: DVec3, at: f64);
    fn ahead(&self, seconds: f64) -> DVec3;
}

struct Hold(DVec3);

impl Way for Hold {
    fn take(&mut self, position: DVec3, _at: f64) {
        self.0 = position;
    }

    fn ahead(&self, _seconds: f64) -> DVec3 {
        self.0
    }
}

/// Casiez, Roussel, Vogel: 1 € filter, CHI 2012: a low pass whose cutoff grows with speed.
struct OneEuro {
    /// Hz, and Hz for a metre a second.
    cutoff: [f64; 2],
    predicts: bool,
    at: f64,
    position: DVec3,
    velocity: DVec3,
}

impl OneEuro {
    fn boxed(predicts: bool, cutoff: [f64; 2]) -> Box<dyn Way> {
        Box::new(Self { cutoff, predicts, at: f64::NAN, position: DVec3::NAN, velocity: DVec3::ZERO })
    }
}

impl Way for OneEuro {
    fn take(&mut self, position: DVec3, at: f64) {
        if self.at.is_nan() {
            (self.at, self.position) = (at, position);
            return;
        }
        let step = at - self.at;
        let share = |cutoff: f64| 1.0 / (1.0 + 1.0 / (TAU * cutoff * step));
        let velocity = (position - self.position) / step;
        self.velocity += share(1.0) * (velocity - self.velocity);
        let cutoff = self.cutoff[0] + self.cutoff[1] * self.velocity.length();
        self.position += share(cutoff) * (position - self.position);
        self.at = at;
    }

    fn ahead(&self, seconds: f64) -> DVec3 {
        self.position + if self.predicts { self.velocity * seconds } else { DVec3::ZERO }
    }
}

/// Fixed gains: of position, and of velocity for a second of step.
struct AlphaBeta {
    gains: [f64; 2],
    at: f64,
    position: DVec3,
    velocity: DVec3,
}

impl AlphaBeta {
    fn boxed(gains: [f64; 2]) -> Box<dyn Way> {
        Box::new(Self { gains, at: f64::NAN, position: DVec3::NAN, velocity: DVec3::ZERO })
    }
}

impl Way for AlphaBeta {
    fn take(&mut self, position: DVec3, at: f64) {
        if self.at.is_nan() {
            (self.at, self.position) = (at, position);
            return;
        }
        let step = at - self.at;
        let innovation = position - (self.position + self.velocity * step);
        self.position += self.velocity * step + self.gains[0] * innovation;
        self.velocity += self.gains[1] / step * innovation;
        self.at = at;
    }

    fn ahead(&self, seconds: f64) -> DVec3 {
        self.position + self.velocity * seconds
    }
}

/// The one that is used.
struct Used(Option<Filter>);

impl Way for Used {
    fn take(&mut self, position: DVec3, at: f64) {
        let at = Duration::from_secs_f64(at);
        match &mut self.0 {
            Some(filter) => filter.take(position, at).unwrap(),
            none => *none = Some(Filter::new(position, at)),
        }
    }

    fn ahead(&self, seconds: f64) -> DVec3 {
        let filter = self.0.as_ref().unwrap();
        filter.predicted(filter.at() + Duration::from_secs_f64(seconds))
    }
}

/// A normal deviate.
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let [a, b]: [f64; 2] = [rng.random(), rng.random()];
    (-2.0 * (1.0 - a).ln()).sqrt() * (TAU * b).cos()
}

type Make = Box<dyn Fn() -> Box<dyn Way>>;

/// Millimetres RMS, the mean over rates and predictions.
fn error_mm(make: &Make, motion: Motion, noise_m: f64) -> f64 {
    let one = |rate: f64| {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let mut way = make();
        let mut squares = [0.0; 3];
        let mut count = 0.0;
        for index in 0..(SECONDS * rate) as u32 {
            let at = f64::from(index) / rate;
            let noise = DVec3::new(normal(&mut rng), normal(&mut rng), normal(&mut rng)) * noise_m;
            way.take(motion(at) + noise, at);
            if at > 1.0 {
                count += 1.0;
                for (sum, ahead) in squares.iter_mut().zip(AHEAD_S) {
                    *sum += way.ahead(ahead).distance_squared(motion(at + ahead));
                }
            }
        }
        squares.map(|sum| (sum / count).sqrt() * 1e3).iter().sum::<f64>() / 3.0
    };
    RATES_HZ.map(one).iter().sum::<f64>() / 3.0
}

#[test]
fn the_filter_predicts_best() {
    let ways: [(&str, Make); 5] = [
        ("the last reading", Box::new(|| Box::new(Hold(DVec3::NAN)))),
        ("one-euro", Box::new(|| OneEuro::boxed(false, [1.0, 20.0]))),
        ("one-euro and its velocity", Box::new(|| OneEuro::boxed(true, [1.0, 20.0]))),
        ("alpha-beta, 0.3 and 0.04", Box::new(|| AlphaBeta::boxed([0.3, 0.04]))),
        ("Kalman, fading and doubting", Box::new(|| Box::new(Used(None)))),
    ];
    println!("| mm RMS | walking, 1 mm | 5 mm | nodding, 1 mm | 5 mm | standing, 1 mm | 5 mm | mean |");
    println!("|---|---|---|---|---|---|---|---|");
    let mut means = Vec::new();
    for (name, make) in &ways {
        let errors: Vec<f64> =
            MOTIONS.iter().flat_map(|motion| [1e-3, 5e-3].map(|noise| error_mm(make, *motion, noise))).collect();
        means.push(errors.iter().sum::<f64>() / errors.len() as f64);
        let cells: Vec<_> = errors.iter().chain(means.last()).map(|error| format!("{error:.1}")).collect();
        println!("| {name} | {} |", cells.join(" | "));
    }
    let (used, others) = means.split_last().unwrap();
    assert!(others.iter().all(|other| used < other), "{means:?}");
    assert!(*used < 0.5 * means[0], "{means:?}");
}
