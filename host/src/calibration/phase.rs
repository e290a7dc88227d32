//! What the encoder tells at the stops: the turn's phase, and where faces look.

use super::{CalibrationError, Click, OnFace, Place};
use protocol::rig::Rig;
use protocol::timing::Direction;

/// The encoder and whoever stops the mirror may differ by so much, degrees: more is a slip of the hand or a wrong sense.
const STOPS_DEG: f64 = 5.0;

/// The azimuths of faces at the index.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Phase {
    /// The mirror angle at the index, degrees; `None` where no click tells: the rig's stays.
    pub phase_offset_deg: Option<f64>,
    /// Face, and azimuth at mirror angle 0 in degrees, of those that clicks tell.
    pub azimuth_deg: Vec<(usize, f64)>,
    /// How far the stops of a face are apart from where they are said to be, degrees: the largest.
    pub off_deg: f64,
}

impl Phase {
    /// From the clicks that come with an encoder's angle. The first such face keeps its azimuth and tells the phase; the others' azimuths
    /// follow.
    pub fn of(rig: &Rig, clicks: &[Click]) -> Result<Self, CalibrationError> {
        let sense = sense(rig);
        let mut phase = Self::default();
        for face in 0..rig.mirror.face.len() {
            let of_face = |click: &Click| match click.place {
                Place::Face(at) if at.face == face => Some(at),
                _ => None,
            };
            let stops: Vec<OnFace> = clicks.iter().filter_map(of_face).collect();
            // Where the face would look at the index.
            let at_index: Vec<f64> =
                stops.iter().filter_map(|at| Some(at.stop_deg - sense * at.encoder_deg?)).collect();
            if at_index.is_empty() {
                continue;
            }
            if at_index.len() < stops.len() {
                return Err(CalibrationError::HalfEncoded(face));
            }
            let mean = mean_deg(&at_index);
            let off_deg = at_index.iter().map(|angle| wrapped_deg(angle - mean).abs()).fold(0.0, f64::max);
            if off_deg > STOPS_DEG {
                return Err(CalibrationError::Stops { face, off_deg: 2.0 * off_deg, allowed_deg: 2.0 * STOPS_DEG });
            }
            phase.off_deg = phase.off_deg.max(2.0 * off_deg);
            match phase.phase_offset_deg {
                None => phase.phase_offset_deg = Some(wrapped_deg(mean - rig.mirror.face[face].azimuth_deg)),
                Some(offset) => phase.azimuth_deg.push((face, wrapped_deg(mean - offset))),
            }
        }
        Ok(phase)
    }

    /// `rig` with it.
    pub fn applied(&self, rig: &Rig) -> Rig {
        let mut told = rig.clone();
        if let Some(offset) = self.phase_offset_deg {
            told.rotation.phase_offset_deg = offset;
        }
        for (face, azimuth) in &self.azimuth_deg {
            told.mirror.face[*face].azimuth_deg = *azimuth;
        }
        told
    }
}

/// `click` at the stop that the encoder tells, which is finer than the hand that stopped the mirror there.
pub fn turned(rig: &Rig, click: &Click) -> Click {
    let mut click = click.clone();
    if let Place::Face(OnFace { face, stop_deg, encoder_deg: Some(encoder), .. }) = &mut click.place {
        *stop_deg = rig.mirror.face[*face].azimuth_deg + rig.rotation.phase_offset_deg + sense(rig) * *encoder;
    }
    click
}

/// +1 where azimuths grow as the mirror turns.
fn sense(rig: &Rig) -> f64 {
    match rig.rotation.direction {
        Direction::CounterClockwise => 1.0,
        Direction::Clockwise => -1.0,
    }
}

fn mean_deg(angles: &[f64]) -> f64 {
    let sum = |part: fn(f64) -> f64| angles.iter().map(|angle| part(angle.to_radians())).sum::<f64>();
    sum(f64::sin).atan2(sum(f64::cos)).to_degrees()
}

/// From −180 up to 180.
fn wrapped_deg(angle: f64) -> f64 {
    (angle + 180.0).rem_euclid(360.0) - 180.0
}
