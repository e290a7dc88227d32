//! The controller's image in an emulator, in place of the native core: QEMU runs it, and every step of the world waits for its answer.
//!
//! The image's own time plays no part, so that a run with it is as repeatable as a native one, and the same bit for bit.

use cable::Cable;
use costs::Costs;
use firmware::config::{Config, ConfigError};
use firmware::controller::{Estimates, Input, Output};
use firmware::fault_log::FaultLog;
use firmware::lockstep::{Answer, HOST_BYTES_MAX, Request, Said, VERSION};
use firmware::plane_store::TurnHandle;
use protocol::message::{Faults, State};
use protocol::units::Nanos;
use std::io::ErrorKind;
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use thiserror::Error;

pub mod bench;
mod cable;
pub mod costs;

/// The emulator, a program of the search path.
const EMULATOR: &str = "qemu-system-arm";
/// An instruction lasts 2⁶ ns by the machine's clock, whose counter ticks every 40 ns. With more ticks than instructions nothing hides
/// between two of them.
const INSTRUCTION_SHIFT: u32 = 6;
const TICK_NS: u64 = 40;
/// An image answers in 0.1 ms; one that takes this long on any machine hangs.
const PATIENCE: Duration = Duration::from_secs(60);
/// A frame that comes before the image's receiver is on is lost: hello is said again.
const HELLO_AGAIN: Duration = Duration::from_millis(100);

/// Why there is no image, or none any more.
#[derive(Debug, Error)]
pub enum ImageError {
    /// See the message.
    #[error("{}: no such image: build it by `cargo build --release` in firmware/boards/mps2", .0.display())]
    Missing(PathBuf),
    /// See the message.
    #[error("{EMULATOR}: {0}: is it installed (Debian: qemu-system-arm)?")]
    Emulator(std::io::Error),
    /// See the message.
    #[error("the emulator ended: {0}")]
    Ended(ExitStatus),
    /// See the message.
    #[error("the image hung up")]
    HungUp,
    /// See the message.
    #[error("the image has not answered for {} s", .0.as_secs_f32())]
    Silent(Duration),
    /// See the message.
    #[error("the image answered {0}")]
    Garbage(String),
    /// See the message.
    #[error("the image speaks version {0} of lockstep, this simulator {VERSION}")]
    Version(u16),
    /// See the message.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// See the message.
    #[error("the cable to the image: {0}")]
    Cable(std::io::Error),
}

/// An image that runs. Dropping it ends the emulator.
#[derive(Debug)]
pub struct Image {
    /// None where somebody else runs it.
    emulator: Option<Emulator>,
    cable: Cable,
    host_wire: Option<TcpStream>,
    costs: Costs,
    failure: Option<ImageError>,
}

/// What the host's bytes came to.
#[derive(Debug, Default)]
pub struct Heard {
    /// How many of them were read.
    pub taken: usize,
    /// What the host is told.
    pub said: Said,
    /// What the controller answered, if it was asked.
    pub output: Option<Output>,
    /// What it took.
    pub instructions: u64,
}

#[derive(Debug)]
struct Emulator(Child);

impl Drop for Emulator {
    fn drop(&mut self) {
        // It may have ended by itself; there is nobody to tell.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Image {
    /// Boots the image in the file `elf`. It has no controller before [`Image::begin`].
    pub fn boot(elf: &Path) -> Result<Self, ImageError> {
        if !elf.is_file() {
            return Err(ImageError::Missing(elf.to_owned()));
        }
        let listen = || TcpListener::bind("127.0.0.1:0").map_err(ImageError::Cable);
        let (world, host) = (listen()?, listen()?);
        let mut emulator = Emulator(emulate(elf, &world, &host).map_err(ImageError::Emulator)?);
        let world = accept(&world, &mut emulator)?;
        let host_wire = Some(accept(&host, &mut emulator)?);
        Self::greet(Some(emulator), world, host_wire, PATIENCE)
    }

    /// An image that somebody else runs, at the other end of `cable`; an answer may take `patience`.
    pub fn over(cable: TcpStream, patience: Duration) -> Result<Self, ImageError> {
        Self::greet(None, cable, None, patience)
    }

    fn greet(
        emulator: Option<Emulator>,
        cable: TcpStream,
        host_wire: Option<TcpStream>,
        patience: Duration,
    ) -> Result<Self, ImageError> {
        let cable = Cable::new(cable, HELLO_AGAIN.min(patience))?;
        let mut image = Self { emulator, cable, host_wire, costs: Costs::default(), failure: None };
        let started = Instant::now();
        loop {
            match image.ask(Request::Hello) {
                Ok(Answer::Hello(VERSION)) => break,
                Ok(Answer::Hello(version)) => return Err(ImageError::Version(version)),
                Ok(answer) => return Err(other(&answer)),
                Err(ImageError::Silent(_)) if started.elapsed() < patience => {}
                Err(ImageError::Silent(_)) => return Err(ImageError::Silent(patience)),
                Err(error) => return Err(error),
            }
        }
        image.cable.set_patience(patience)?;
        Ok(image)
    }

    /// A new controller on the same image: as new as one that has just booted.
    pub fn begin(&mut self, config: &Config) -> Result<(), ImageError> {
        let config = config.checked()?;
        self.costs.begin(config.rotation.planes_nanos(1));
        match self.ask(Request::Begin(config))? {
            Answer::Begun => Ok(()),
            answer => Err(other(&answer)),
        }
    }

    /// One step of its controller.
    pub fn step(&mut self, now: Nanos, input: Input) -> Result<Output, ImageError> {
        match self.ask(Request::Step { now, input })? {
            Answer::Stepped { output, ticks } => {
                self.costs.add(now, &input, instructions(ticks));
                Ok(output)
            }
            answer => Err(other(&answer)),
        }
    }

    /// What its controller believes.
    pub fn estimates(&mut self) -> Result<Estimates, ImageError> {
        match self.ask(Request::Estimates)? {
            Answer::Estimates(estimates) => Ok(estimates),
            answer => Err(other(&answer)),
        }
    }

    /// Gives the host's `bytes` to its end of the wire, up to the end of the first packet.
    pub fn hear(&mut self, now: Nanos, bytes: &[u8]) -> Result<Heard, ImageError> {
        let bytes = bytes.get(..HOST_BYTES_MAX).unwrap_or(bytes);
        match self.ask(Request::Host { now, bytes })? {
            Answer::Heard { taken, said, output, ticks } => {
                Ok(Heard { taken: taken.into(), said, output, instructions: instructions(ticks) })
            }
            answer => Err(other(&answer)),
        }
    }

    /// What the host is told of the controller now.
    pub fn report(&mut self) -> Result<Said, ImageError> {
        match self.ask(Request::Report)? {
            Answer::Said(said) => Ok(said),
            answer => Err(other(&answer)),
        }
    }

    /// The check of a plane in its frame store; nothing where its turn is not whole.
    pub fn plane(&mut self, turn: TurnHandle, slice: u16) -> Result<Option<u64>, ImageError> {
        match self.ask(Request::Plane { turn, slice })? {
            Answer::Plane(check) => Ok(check),
            answer => Err(other(&answer)),
        }
    }

    /// Its faults so far.
    pub fn faults(&mut self) -> Result<Faults, ImageError> {
        match self.ask(Request::Faults)? {
            Answer::Faults(faults) => Ok(faults),
            answer => Err(other(&answer)),
        }
    }

    /// The deepest that the image's stack has been since it booted, bytes.
    pub fn stack_bytes(&mut self) -> Result<u32, ImageError> {
        match self.ask(Request::StackBytes)? {
            Answer::StackBytes(bytes) => Ok(bytes),
            answer => Err(other(&answer)),
        }
    }

    /// How many instructions a thousand are, by the image's counter.
    pub fn thousand(&mut self) -> Result<u64, ImageError> {
        match self.ask(Request::Thousand)? {
            Answer::Thousand(ticks) => Ok(instructions(ticks)),
            answer => Err(other(&answer)),
        }
    }

    /// The host's serial port; once. Orders that come by it are carried out at a time that depends on this machine.
    pub fn take_host_wire(&mut self) -> Option<TcpStream> {
        self.host_wire.take()
    }

    /// Instructions of its steps since it booted.
    pub fn costs(&self) -> &Costs {
        &self.costs
    }

    /// Why it failed, if it has: every answer since was made up, dark and without torque.
    pub fn failure(&self) -> Option<&ImageError> {
        self.failure.as_ref()
    }

    fn ask(&mut self, request: Request<'_>) -> Result<Answer, ImageError> {
        self.cable.ask(request).map_err(|error| self.named(error))
    }

    /// An emulator that ended is a better reason than a cable that was cut.
    fn named(&mut self, error: ImageError) -> ImageError {
        let ended = self.emulator.as_mut().and_then(|emulator| emulator.0.try_wait().ok().flatten());
        match (error, ended) {
            (ImageError::HungUp | ImageError::Cable(_), Some(status)) => ImageError::Ended(status),
            (error, _) => error,
        }
    }
}

/// So many instructions are `ticks` of the counter.
fn instructions(ticks: u32) -> u64 {
    (u64::from(ticks) * TICK_NS + (1 << (INSTRUCTION_SHIFT - 1))) >> INSTRUCTION_SHIFT
}

/// An answer to another question.
fn other(answer: &Answer) -> ImageError {
    ImageError::Garbage(format!("{answer:?}"))
}

fn emulate(elf: &Path, world: &TcpListener, host: &TcpListener) -> std::io::Result<Child> {
    let (world, host) = (world.local_addr()?, host.local_addr()?);
    Command::new(EMULATOR)
        .args(["-machine", "mps2-an386", "-display", "none", "-monitor", "none"])
        .args(["-icount", &format!("shift={INSTRUCTION_SHIFT},sleep=on")])
        .args(["-nic", &format!("socket,connect={world}")])
        .args(["-chardev", &format!("socket,id=host,host={},port={},nodelay=on", host.ip(), host.port())])
        .args(["-serial", "chardev:host"])
        .arg("-kernel")
        .arg(elf)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .spawn()
}

/// The emulator's call; an error where it ends before.
fn accept(listener: &TcpListener, emulator: &mut Emulator) -> Result<TcpStream, ImageError> {
    listener.set_nonblocking(true).map_err(ImageError::Cable)?;
    let started = Instant::now();
    loop {
        match listener.accept() {
            Ok((stream, _)) => {
                stream.set_nonblocking(false).map_err(ImageError::Cable)?;
                return Ok(stream);
            }
            Err(error) if error.kind() != ErrorKind::WouldBlock => return Err(ImageError::Cable(error)),
            Err(_) => {}
        }
        if let Some(status) = emulator.0.try_wait().map_err(ImageError::Emulator)? {
            return Err(ImageError::Ended(status));
        }
        if started.elapsed() > PATIENCE {
            return Err(ImageError::Silent(PATIENCE));
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// An image that a world and whoever looks after it share.
#[derive(Clone, Debug)]
pub struct SharedImage(Arc<Mutex<Image>>);

impl SharedImage {
    /// Shares `image`.
    pub fn new(image: Image) -> Self {
        Self(Arc::new(Mutex::new(image)))
    }

    /// The image.
    pub fn lock(&self) -> MutexGuard<'_, Image> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl SharedImage {
    /// What `ask` gets of it, or what is safe where it has failed.
    fn get<T: Default>(&self, ask: impl FnOnce(&mut Image) -> Result<T, ImageError>) -> T {
        self.try_get(ask).unwrap_or_default()
    }

    fn try_get<T>(&self, ask: impl FnOnce(&mut Image) -> Result<T, ImageError>) -> Option<T> {
        let mut image = self.lock();
        if image.failure.is_some() {
            return None;
        }
        ask(&mut image).map_err(|error| image.failure = Some(error)).ok()
    }
}

impl crate::world::Core for SharedImage {
    fn step(&mut self, now: Nanos, input: Input) -> Output {
        let safe = Output { state: State::Fault, ..Output::default() };
        self.try_get(|image| image.step(now, input)).unwrap_or(safe)
    }

    fn estimates(&self) -> Estimates {
        self.get(Image::estimates)
    }

    fn faults(&self) -> Faults {
        self.try_get(Image::faults).unwrap_or_else(|| FaultLog::default().faults())
    }
}

#[cfg(test)]
mod tests;
