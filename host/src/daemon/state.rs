//! What outlives the daemon: the wish and what happened, in one file that is replaced whole.

use super::telemetry::Event;
use super::wish::Wish;
use crate::input;
use serde::{Deserialize, Serialize};
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// So many events are kept.
const EVENTS_MAX: usize = 200;
const FILE: &str = "state.json";

/// What is kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// What is to be seen.
    pub wish: Wish,
    /// What happened, the oldest first.
    pub events: Vec<Event>,
}

/// Where it is kept, for one daemon at a time.
#[derive(Debug)]
pub struct Store {
    folder: PathBuf,
    /// Locked as long as the daemon lives.
    _lock: fs::File,
}

/// What an earlier daemon left.
#[derive(Debug)]
pub enum Left {
    /// Nothing: it is the first.
    Nothing,
    /// What it wanted to see.
    State(Box<State>),
    /// Something that cannot be read, which is kept under this name.
    Damaged(PathBuf),
}

impl Store {
    /// Over `folder`, which is made. Another daemon that has it is an error of kind [`io::ErrorKind::ResourceBusy`].
    pub fn open(folder: &Path) -> io::Result<Self> {
        if folder.exists() && !folder.is_dir() {
            return Err(io::Error::new(
                io::ErrorKind::NotADirectory,
                "is no folder: state_dir must be one, or a name for one",
            ));
        }
        fs::create_dir_all(folder)?;
        let lock = fs::File::options().create(true).truncate(false).write(true).open(folder.join("lock"))?;
        match lock.try_lock() {
            Ok(()) => Ok(Self { folder: folder.into(), _lock: lock }),
            Err(fs::TryLockError::WouldBlock) => Err(io::Error::new(
                io::ErrorKind::ResourceBusy,
                "another praxi run has it: end that one, or give each a state_dir of its own",
            )),
            Err(fs::TryLockError::Error(error)) => Err(error),
        }
    }

    /// What an earlier daemon left.
    pub fn load(&self) -> io::Result<Left> {
        let path = self.folder.join(FILE);
        let text = match input::read_text(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Left::Nothing),
            Err(error) => return Err(error),
        };
        let state = serde_json::from_str::<State>(&text).ok().filter(|state| state.wish.check().is_ok());
        match state {
            Some(state) => Ok(Left::State(Box::new(state))),
            None => {
                let aside = self.folder.join("state.damaged.json");
                fs::rename(&path, &aside)?;
                Ok(Left::Damaged(aside))
            }
        }
    }

    /// Keeps `state` in place of what was there: whole, or not at all.
    pub fn save(&self, mut state: State) -> io::Result<()> {
        state.events = state.events.split_off(state.events.len().saturating_sub(EVENTS_MAX));
        let mut file = tempfile::NamedTempFile::new_in(&self.folder)?;
        file.write_all(&serde_json::to_vec_pretty(&state)?)?;
        file.as_file().sync_all()?;
        file.persist(self.folder.join(FILE)).map_err(|error| error.error)?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::telemetry::EventKind;
    use crate::daemon::wish::{Animation, Mode, Transform};
    use crate::pattern::Pattern;
    use crate::render::plan::Halftone;

    fn state(events: u64) -> State {
        let event = |number| Event { number, unix_s: 0.5, kind: EventKind::Note, text: "text".into() };
        State {
            wish: Wish {
                mode: Mode::Scene,
                pattern: Pattern::Grid,
                scene: "builtin".into(),
                transform: Transform::default(),
                animation: Animation::SPIN,
                budget_px: 0.5,
                halftone: Halftone::BlueNoise,
                motor: true,
            },
            events: (1..=events).map(event).collect(),
        }
    }

    #[test]
    fn what_was_kept_comes_back() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        assert!(matches!(store.load(), Ok(Left::Nothing)));
        store.save(state(300)).unwrap();
        let Ok(Left::State(back)) = store.load() else { panic!("nothing came back") };
        assert_eq!((back.wish, back.events.len(), back.events[0].number), (state(0).wish, EVENTS_MAX, 101));
    }

    #[test]
    fn what_is_damaged_is_put_aside() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        store.save(state(1)).unwrap();
        let path = folder.path().join(FILE);
        let text = fs::read_to_string(&path).unwrap();
        for damaged in [&text[..text.len() / 2], "", "{}", &text.replace("0.5", "-0.5")] {
            fs::write(&path, damaged).unwrap();
            assert!(matches!(store.load(), Ok(Left::Damaged(_))), "{damaged}");
            assert!(matches!(store.load(), Ok(Left::Nothing)));
        }
    }

    #[test]
    fn two_daemons_do_not_share_one() {
        let folder = tempfile::tempdir().unwrap();
        let first = Store::open(folder.path()).unwrap();
        assert_eq!(Store::open(folder.path()).unwrap_err().kind(), io::ErrorKind::ResourceBusy);
        drop(first);
        assert!(Store::open(folder.path()).is_ok());
    }
}
