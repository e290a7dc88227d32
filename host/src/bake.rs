//! A turn whose halftone is searched over all its slices together; the work is saved as it goes, to be stopped and taken up again.

use crate::input;
use crate::output::{self, OutputError};
use crate::render::joint::Joint;
use crate::render::turn::{Turn, TurnTooLarge};
use crc::{CRC_64_XZ, Crc};
use protocol::rig::Rig;
use std::io::ErrorKind;
use std::path::{Path, PathBuf, absolute};
use thiserror::Error;

/// With what a checkpoint begins.
const MAGIC: &[u8] = b"praxi bake 1\n";
const CRC: Crc<u64> = Crc::<u64>::new(&CRC_64_XZ);
/// The magic, the job and the stage before the bits, the checksum after them.
const FRAME_BYTES: usize = MAGIC.len() + 8 + 4 + 8;

/// Why a turn cannot be baked.
#[derive(Debug, Error)]
pub enum BakeError {
    /// The bits would not fit in memory.
    #[error(transparent)]
    TurnTooLarge(#[from] TurnTooLarge),
    /// The checkpoint cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// Something is where the checkpoint belongs.
    #[error("{0}: is there and no checkpoint of praxi bake: name another folder, or move it away")]
    Foreign(PathBuf),
    /// The checkpoint cannot be read.
    #[error("{0}: {1}")]
    Unreadable(PathBuf, std::io::Error),
}

/// What was found of an earlier run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Found {
    /// Nothing.
    Nothing,
    /// A checkpoint of another scene, rig, or number of sweeps, or by another version: it is not used.
    OtherJob,
    /// A checkpoint whose bytes changed: it is not used.
    Damaged,
    /// This job's checkpoint: it goes on from there.
    Halfway,
}

/// A turn being searched.
pub struct Bake<'a> {
    joint: Joint<'a>,
    turn: Turn,
    /// Stages done and to do.
    stage: u32,
    stages: u32,
    job: u64,
    checkpoint: PathBuf,
}

impl<'a> Bake<'a> {
    /// Begins `sweeps` sweeps toward the slices of `grey`, which must hold grey, or takes them up where an earlier run for the
    /// folder `out` was stopped.
    pub fn begin(rig: &'a Rig, grey: &'a Turn, sweeps: u32, out: &Path) -> Result<(Self, Found), BakeError> {
        let joint = Joint::new(rig, grey);
        let checkpoint = checkpoint_of(out);
        let (job, stages) = (job(rig, grey, sweeps), sweeps * joint.stages());
        let mut bake = Self { turn: joint.start()?, joint, stage: 0, stages, job, checkpoint };
        let found = bake.load()?;
        Ok((bake, found))
    }

    /// Where the work is saved: beside the folder that it is for.
    pub fn checkpoint(&self) -> &Path {
        &self.checkpoint
    }

    /// Slices searched so far, and in all: each once a sweep.
    pub fn progress(&self) -> [u64; 2] {
        let count = |stages: core::ops::Range<u32>| stages.map(|stage| self.joint.members(stage).len() as u64).sum();
        [count(0..self.stage), count(0..self.stages)]
    }

    /// Does one stage of a sweep and saves it; false where none is left. `done` is called from any thread after each slice.
    pub fn step(&mut self, done: &(dyn Fn() + Sync)) -> Result<bool, BakeError> {
        if self.stage == self.stages {
            return Ok(false);
        }
        self.joint.improve(&mut self.turn, self.stage, done);
        self.stage += 1;
        self.save()?;
        Ok(true)
    }

    /// The turn as it is now.
    pub fn turn(&self) -> &Turn {
        &self.turn
    }

    /// Removes the checkpoint: the result is safe elsewhere.
    pub fn forget(self) -> Result<(), BakeError> {
        match std::fs::remove_file(&self.checkpoint) {
            Err(error) if error.kind() != ErrorKind::NotFound => Err(BakeError::Unreadable(self.checkpoint, error)),
            _ => Ok(()),
        }
    }

    fn save(&self) -> Result<(), BakeError> {
        let mut bytes = Vec::with_capacity(FRAME_BYTES + self.turn.bytes().len());
        bytes.extend_from_slice(MAGIC);
        bytes.extend_from_slice(&self.job.to_le_bytes());
        bytes.extend_from_slice(&self.stage.to_le_bytes());
        bytes.extend_from_slice(self.turn.bytes());
        bytes.extend_from_slice(&CRC.checksum(&bytes).to_le_bytes());
        Ok(output::File::begin_over(&self.checkpoint)?.finish(&bytes)?)
    }

    fn load(&mut self) -> Result<Found, BakeError> {
        let unreadable = |error| BakeError::Unreadable(self.checkpoint.clone(), error);
        if !self.checkpoint.exists() {
            return Ok(Found::Nothing);
        }
        if !input::begins_with(&self.checkpoint, MAGIC).map_err(unreadable)? {
            return Err(BakeError::Foreign(self.checkpoint.clone()));
        }
        let bits = self.turn.bytes().len();
        let bytes = match input::read(&self.checkpoint, (FRAME_BYTES + bits) as u64) {
            Err(error) if error.kind() == ErrorKind::FileTooLarge => return Ok(Found::OtherJob),
            bytes => bytes.map_err(unreadable)?,
        };
        let Some((framed, checksum)) = bytes.split_last_chunk::<8>() else { return Ok(Found::Damaged) };
        if CRC.checksum(framed) != u64::from_le_bytes(*checksum) {
            return Ok(Found::Damaged);
        }
        let (Some((job, rest)), true) =
            (framed[MAGIC.len()..].split_first_chunk::<8>(), bytes.len() == FRAME_BYTES + bits)
        else {
            return Ok(Found::OtherJob);
        };
        let (stage, planes) = rest.split_first_chunk::<4>().expect("a length that was checked");
        let stage = u32::from_le_bytes(*stage);
        if u64::from_le_bytes(*job) != self.job || stage > self.stages {
            return Ok(Found::OtherJob);
        }
        self.turn.bytes_mut().copy_from_slice(planes);
        self.stage = stage;
        Ok(Found::Halfway)
    }
}

/// `turn.bake` for the folder `turn`.
fn checkpoint_of(out: &Path) -> PathBuf {
    let out = out.canonicalize().or_else(|_| absolute(out)).unwrap_or_else(|_| out.into());
    let mut name = out.file_name().unwrap_or_default().to_os_string();
    name.push(".bake");
    out.with_file_name(name)
}

/// By what a job is told from another: whatever its bits follow from.
fn job(rig: &Rig, grey: &Turn, sweeps: u32) -> u64 {
    let mut digest = CRC.digest();
    digest.update(env!("CARGO_PKG_VERSION").as_bytes());
    digest.update(serde_json::to_string(rig).expect("numbers and strings").as_bytes());
    digest.update(&sweeps.to_le_bytes());
    digest.update(grey.bytes());
    digest.finalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::turn::Depth;
    use crate::rigs;
    use std::fs;

    /// 24 slices of 64 × 64 pixels: a grey disc that brightens from slice to slice.
    fn job() -> (Rig, Turn) {
        let mut rig = rigs::find("reference").unwrap();
        (rig.rotation.slices, rig.projector.width_px, rig.projector.height_px) = (24, 64, 64);
        (rig.projector.focal_px, rig.projector.principal_px) = (Some(256.0), Some([32.0, 32.0]));
        rig.mirror.face[0].diffuser_hat_radius_deg = Some(15.0);
        let mut grey = Turn::dark(24, 64, 64, Depth::Grey).unwrap();
        for (cell, byte) in grey.bytes_mut().iter_mut().enumerate() {
            let (x, y, slice) = (cell % 64, cell / 64 % 64, cell / 4096);
            *byte = if x.abs_diff(32).pow(2) + y.abs_diff(32).pow(2) < 600 { (8 * slice + x) as u8 } else { 0 };
        }
        (rig, grey)
    }

    fn finish(bake: &mut Bake<'_>) -> Vec<u8> {
        while bake.step(&|| ()).unwrap() {}
        bake.turn().bytes().to_vec()
    }

    #[test]
    fn stopped_and_taken_up_it_ends_the_same() {
        let (folder, (rig, grey)) = (tempfile::tempdir().unwrap(), job());
        let begin = |name: &str| Bake::begin(&rig, &grey, 3, &folder.path().join(name)).unwrap();
        let (mut whole, found) = begin("whole");
        assert_eq!(found, Found::Nothing);
        let [before, all] = whole.progress();
        let whole = finish(&mut whole);
        assert_eq!([before, all], [0, 72]);
        for stop in [1, 2, 3] {
            let (mut bake, _) = begin("turn");
            (0..stop).for_each(|_| assert!(bake.step(&|| ()).unwrap()));
            let [searched, _] = bake.progress();
            drop(bake);
            let (mut bake, found) = begin("turn");
            assert_eq!((found, bake.progress()[0]), (Found::Halfway, searched));
            assert!(finish(&mut bake) == whole);
            bake.forget().unwrap();
            assert!(!folder.path().join("turn.bake").exists());
        }
        let lone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert!(lone.install(|| finish(&mut begin("lone").0)) == whole, "the number of threads matters");
    }

    #[test]
    fn only_a_sound_checkpoint_of_the_same_job_is_taken() {
        let (folder, (mut rig, mut grey)) = (tempfile::tempdir().unwrap(), job());
        let (out, path) = (folder.path().join("turn"), folder.path().join("turn.bake"));
        Bake::begin(&rig, &grey, 3, &out).unwrap().0.step(&|| ()).unwrap();
        let found = |rig: &Rig, grey: &Turn, sweeps: u32| Bake::begin(rig, grey, sweeps, &out).map(|(_, found)| found);
        assert_eq!(found(&rig, &grey, 3).unwrap(), Found::Halfway);
        assert_eq!(found(&rig, &grey, 4).unwrap(), Found::OtherJob);
        let sound = fs::read(&path).unwrap();
        for place in [MAGIC.len(), MAGIC.len() + 9, 1000, sound.len() - 1] {
            let mut bytes = sound.clone();
            bytes[place] ^= 4;
            fs::write(&path, bytes).unwrap();
            assert_eq!(found(&rig, &grey, 3).unwrap(), Found::Damaged, "byte {place}");
        }
        fs::write(&path, &sound[..sound.len() / 2]).unwrap();
        assert_eq!(found(&rig, &grey, 3).unwrap(), Found::Damaged);
        fs::write(&path, [&sound[..], &sound[..]].concat()).unwrap();
        assert_eq!(found(&rig, &grey, 3).unwrap(), Found::OtherJob);
        fs::write(&path, &sound).unwrap();
        rig.mirror.face[0].tilt_deg += 1e-9;
        assert_eq!(found(&rig, &grey, 3).unwrap(), Found::OtherJob);
        rig.mirror.face[0].tilt_deg = 45.0;
        grey.bytes_mut()[2048] ^= 1;
        assert_eq!(found(&rig, &grey, 3).unwrap(), Found::OtherJob);
        fs::write(&path, "somebody's notes").unwrap();
        assert!(matches!(found(&rig, &grey, 3), Err(BakeError::Foreign(_))));
        assert_eq!(fs::read_to_string(&path).unwrap(), "somebody's notes");
        fs::remove_file(&path).unwrap();
        fs::create_dir(&path).unwrap();
        assert!(matches!(found(&rig, &grey, 3), Err(BakeError::Foreign(_))));
    }
}
