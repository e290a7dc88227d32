//! How the nodes of a glTF document move: glTF 2.0, section 3.11 and appendix C.

use std::collections::HashSet;

use gltf::animation::{Interpolation, Property};
use gltf::json::validation::Checked;
use gltf::scene::Transform;
use gltf::{Accessor, Document};

use super::Fault;
use super::assembly::in_range;
use super::gltf_accessor::Buffers;
use super::gltf_model::{Model, Pose};

/// Numbers of all keyframes together, 256 MiB: a small file can name the same keyframes for many nodes.
const NUMBERS_MAX: usize = 1 << 26;

/// A way in which a scene moves.
#[derive(Clone, Debug)]
pub struct Clip {
    /// As in the file, or `clip 0`.
    pub name: String,
    /// How long it is: the time of its last keyframe, seconds.
    pub seconds: f64,
    tracks: Vec<Track>,
}

/// A property of a node over time.
#[derive(Clone, Debug)]
struct Track {
    node: usize,
    property: Property,
    interpolation: Interpolation,
    /// Seconds, ascending, at least one.
    times: Vec<f32>,
    /// So many numbers a value.
    width: usize,
    /// A value per time; for splines three: the tangent that leads to it, the value, the tangent that leads on.
    values: Vec<f32>,
}

/// All clips of a document.
pub(super) fn read(document: &Document, buffers: &Buffers, model: &Model) -> Result<Vec<Clip>, Fault> {
    let rest = model.rest();
    let mut reader = Reader { document, buffers, rest: &rest, numbers: 0 };
    document.animations().map(|animation| reader.clip(&animation)).collect()
}

impl Clip {
    /// Moves what it moves in `pose` to where it is at `seconds`.
    pub(super) fn apply(&self, seconds: f64, pose: &mut Pose) {
        for track in &self.tracks {
            track.apply(seconds, pose);
        }
    }
}

impl Track {
    fn apply(&self, seconds: f64, pose: &mut Pose) {
        if self.property == Property::MorphTargetWeights {
            let weights = &mut pose.weights[self.node];
            (0..weights.len()).for_each(|i| weights[i] = self.number(seconds, i));
            return;
        }
        let Transform::Decomposed { translation, rotation, scale } = &mut pose.transforms[self.node] else { return };
        match self.property {
            Property::Rotation => *rotation = self.rotation(seconds),
            Property::Scale => *scale = std::array::from_fn(|i| self.number(seconds, i)),
            _ => *translation = std::array::from_fn(|i| self.number(seconds, i)),
        }
    }

    /// Where a moment lies: the keyframe before it, and how far it is to the next, 0 to 1. Before the first and from the last one on nothing
    /// moves.
    fn place(&self, seconds: f64) -> (usize, f64) {
        let after = self.times.partition_point(|&time| f64::from(time) <= seconds);
        if after == 0 || after == self.times.len() {
            return (after.saturating_sub(1), 0.0);
        }
        let [from, to] = [after - 1, after].map(|i| f64::from(self.times[i]));
        (after - 1, (seconds - from) / (to - from))
    }

    /// A component of the value at a moment.
    fn number(&self, seconds: f64, component: usize) -> f32 {
        let (key, part) = self.place(seconds);
        if part == 0.0 {
            return self.value(key, component);
        }
        match self.interpolation {
            Interpolation::Step => self.value(key, component),
            Interpolation::Linear => {
                let [from, to] = [key, key + 1].map(|key| f64::from(self.value(key, component)));
                (from + part * (to - from)) as f32
            }
            Interpolation::CubicSpline => self.spline(key, part, component),
        }
    }

    /// A quaternion; whoever uses it brings its length to 1.
    fn rotation(&self, seconds: f64) -> [f32; 4] {
        let (key, part) = self.place(seconds);
        if part > 0.0 && self.interpolation == Interpolation::Linear {
            let [from, to] = [key, key + 1].map(|key| std::array::from_fn(|i| self.value(key, i).into()));
            return slerp(from, to, part).map(|component| component as f32);
        }
        std::array::from_fn(|i| self.number(seconds, i))
    }

    fn value(&self, key: usize, component: usize) -> f32 {
        let place = if self.interpolation == Interpolation::CubicSpline { 3 * key + 1 } else { key };
        self.values[place * self.width + component]
    }

    /// Appendix C.5: Hermite's cubic between two keyframes, by their tangents per second.
    fn spline(&self, key: usize, t: f64, component: usize) -> f32 {
        let number = |place: usize| f64::from(self.values[place * self.width + component]);
        let seconds = f64::from(self.times[key + 1]) - f64::from(self.times[key]);
        let [from, out, into, to] =
            [number(3 * key + 1), number(3 * key + 2), number(3 * (key + 1)), number(3 * (key + 1) + 1)];
        let (t2, t3) = (t * t, t * t * t);
        let values = (2.0 * t3 - 3.0 * t2 + 1.0) * from + (3.0 * t2 - 2.0 * t3) * to;
        let tangents = (t3 - 2.0 * t2 + t) * out + (t3 - t2) * into;
        (values + seconds * tangents) as f32
    }
}

/// Appendix C.4: the shorter arc between two rotations at constant speed.
fn slerp(from: [f64; 4], to: [f64; 4], part: f64) -> [f64; 4] {
    let [from, to] = [from, to].map(unit);
    let cosine: f64 = from.iter().zip(to).map(|(a, b)| a * b).sum();
    let angle = cosine.abs().min(1.0).acos();
    let side = 1.0_f64.copysign(cosine);
    // Where both are the same the arc is a chord.
    let [first, second] = match angle.sin() {
        sine if sine > 1e-9 => [((1.0 - part) * angle).sin() / sine, (part * angle).sin() / sine],
        _ => [1.0 - part, part],
    };
    std::array::from_fn(|i| first * from[i] + side * second * to[i])
}

/// Of length 1; without a length it turns nothing.
fn unit(quaternion: [f64; 4]) -> [f64; 4] {
    let length = quaternion.iter().map(|component| component * component).sum::<f64>().sqrt();
    if length > 0.0 { quaternion.map(|component| component / length) } else { [0.0, 0.0, 0.0, 1.0] }
}

struct Reader<'a> {
    document: &'a Document,
    buffers: &'a Buffers,
    rest: &'a Pose,
    /// Of keyframes so far.
    numbers: usize,
}

impl Reader<'_> {
    fn clip(&mut self, animation: &gltf::Animation<'_>) -> Result<Clip, Fault> {
        let json = &self.document.as_json().animations[animation.index()];
        let mut seen = HashSet::new();
        let mut tracks = Vec::with_capacity(json.channels.len());
        for (number, channel) in json.channels.iter().enumerate() {
            let place = format!("animation {} channel {number}", animation.index());
            // The crate's validation (1.4.1) does not look at targets.
            let node = channel.target.node.value();
            let nodes = self.rest.transforms.len();
            if node >= nodes {
                let allowed = format!("nodes 0 to {}", nodes as i64 - 1);
                return Err(Fault::IndexOutOfRange { place, index: node as i64, allowed });
            }
            let Checked::Valid(property) = channel.target.path else {
                let problem = "its target has an unknown path, allowed are translation, rotation, scale and weights";
                return Err(Fault::malformed(place, problem));
            };
            if !seen.insert((node, property as u8)) {
                return Err(Fault::malformed(
                    place,
                    format!("moves node {node} where another channel of its animation does"),
                ));
            }
            let sampler = animation.samplers().nth(channel.sampler.value());
            let sampler = sampler.ok_or_else(|| Fault::malformed(&place, "its sampler is not there"))?;
            tracks.push(self.track(&place, node, property, &sampler)?);
        }
        let last = |track: &Track| track.times.last().copied().unwrap_or_default();
        Ok(Clip {
            name: animation.name().map_or_else(|| format!("clip {}", animation.index()), str::to_owned),
            seconds: tracks.iter().map(last).fold(0.0, f32::max).into(),
            tracks,
        })
    }

    fn track(
        &mut self,
        place: &str,
        node: usize,
        property: Property,
        sampler: &gltf::animation::Sampler<'_>,
    ) -> Result<Track, Fault> {
        let (input, output, interpolation) = (sampler.input(), sampler.output(), sampler.interpolation());
        let width = self.width(place, node, property)?;
        self.take(place, &input, &output)?;
        let times: Vec<f32> = self.buffers.floats::<1>(place, &input)?.into_iter().flatten().collect();
        check_times(place, &times)?;
        let values = self.values(place, property, &output)?;
        let per_time = if interpolation == Interpolation::CubicSpline { 3 * width } else { width };
        if values.len() != times.len() * per_time {
            let problem =
                format!("{} numbers for {} keyframes, allowed are {per_time} for each", values.len(), times.len());
            return Err(Fault::malformed(place, problem));
        }
        if let Some(wrong) = values.iter().find(|value| !in_range(**value)) {
            return Err(Fault::NotFinite { place: place.into(), what: "value", value: wrong.to_string() });
        }
        Ok(Track { node, property, interpolation, times, width, values })
    }

    /// Numbers of a value of what is animated, where it can be.
    fn width(&self, place: &str, node: usize, property: Property) -> Result<usize, Fault> {
        if property == Property::MorphTargetWeights {
            let targets = self.rest.weights[node].len();
            let problem = || format!("weights of node {node}, which has no morph targets");
            return if targets > 0 { Ok(targets) } else { Err(Fault::malformed(place, problem())) };
        }
        if matches!(self.rest.transforms[node], Transform::Matrix { .. }) {
            let problem =
                format!("node {node} has a matrix, allowed are translation, rotation and scale where it moves");
            return Err(Fault::malformed(place, problem));
        }
        Ok(if property == Property::Rotation { 4 } else { 3 })
    }

    fn values(&self, place: &str, property: Property, output: &Accessor<'_>) -> Result<Vec<f32>, Fault> {
        Ok(match property {
            Property::Rotation => self.buffers.floats::<4>(place, output)?.into_flattened(),
            Property::MorphTargetWeights => self.buffers.floats::<1>(place, output)?.into_flattened(),
            Property::Translation | Property::Scale => self.buffers.floats::<3>(place, output)?.into_flattened(),
        })
    }

    /// Refuses keyframes that there is no room for, before memory is spent on them.
    fn take(&mut self, place: &str, input: &Accessor<'_>, output: &Accessor<'_>) -> Result<(), Fault> {
        let numbers = output.count().saturating_mul(output.dimensions().multiplicity());
        self.numbers = self.numbers.saturating_add(numbers).saturating_add(input.count());
        if self.numbers > NUMBERS_MAX {
            let (count, what, limit) = (self.numbers as u64, "numbers of keyframes so far", NUMBERS_MAX as u64);
            return Err(Fault::TooLarge { place: place.into(), count, what, limit });
        }
        Ok(())
    }
}

/// At least one, none below 0, each above the one before.
fn check_times(place: &str, times: &[f32]) -> Result<(), Fault> {
    if let Some(wrong) = times.iter().find(|time| !in_range(**time)) {
        return Err(Fault::NotFinite { place: place.into(), what: "time", value: wrong.to_string() });
    }
    let problem = match times.first() {
        None => "no keyframe, at least one is needed".to_owned(),
        Some(first) if *first < 0.0 => format!("begins at {first} s, allowed are 0 and later"),
        Some(_) => match times.windows(2).find(|pair| pair[1] <= pair[0]) {
            Some(pair) => format!("a keyframe at {} s after one at {} s, allowed are later ones", pair[1], pair[0]),
            None => return Ok(()),
        },
    };
    Err(Fault::malformed(place, problem))
}
