//! A server of USB/IP: a simulated USB device that a Linux kernel attaches as if it were plugged in.

pub mod wire;

use crate::served::{Pump, STEP};
use crate::usb::descriptors::Descriptors;
use crate::usb::{Function, Port};
use std::io::{BufReader, Read, Write};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::{Duration, Instant};
use wire::{BUS_ID, Command, Denial, Request, UsbIpError};

/// Messages that are read ahead.
const AHEAD: usize = 8;
/// What a client may have pending at once: transfers, and their bytes.
const PENDING_MAX: (usize, usize) = (1024, 64 << 20);
/// What a simulation that is slower than the wall's clock does not catch up with: messages wait meanwhile.
const LAG_MAX: Duration = Duration::from_millis(20);

/// How a client lost the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// It let go of it.
    HostLeft,
    /// The device left the bus: it was pulled out, or starts anew.
    DeviceLeft,
}

/// Answers a client's first message, which is `request`; whether the device is now its own.
pub fn greet(
    request: &Request,
    writer: &mut impl Write,
    descriptors: &Descriptors,
    is_free: bool,
) -> Result<bool, UsbIpError> {
    let (answer, is_given) = match request {
        Request::List => (wire::list(descriptors), false),
        Request::Import(name) if name != BUS_ID => (wire::denied(Denial::Absent), false),
        Request::Import(_) if is_free => (wire::imported(descriptors), true),
        Request::Import(_) => (wire::denied(Denial::Busy), false),
    };
    writer.write_all(&answer)?;
    Ok(is_given)
}

/// Serves `port` to a client that it was given to, until one of them leaves: plugs it in, and out at the end. `watch` is called about
/// every millisecond, and may do to the port what it likes.
///
/// At the end the caller shuts the connection down: only then does the thread end that reads from it.
pub fn serve<F: Function>(
    reader: impl Read + Send + 'static,
    mut writer: impl Write,
    port: &mut Port<F>,
    watch: impl FnMut(&mut Port<F>),
) -> Result<Ending, UsbIpError> {
    let commands = read_ahead(reader);
    port.plug();
    let ending = exchange(&commands, &mut writer, port, watch);
    port.unplug();
    ending
}

/// What came from the client.
type Came = Result<Option<Command>, UsbIpError>;

fn read_ahead(reader: impl Read + Send + 'static) -> Receiver<Came> {
    // A message's header at once; most of its data go past the buffer.
    let mut reader = BufReader::with_capacity(1024, reader);
    let (sender, commands) = sync_channel(AHEAD);
    std::thread::spawn(move || {
        loop {
            let command = wire::read_command(&mut reader);
            let is_last = !matches!(command, Ok(Some(_)));
            if sender.send(command).is_err() || is_last {
                return;
            }
        }
    });
    commands
}

fn exchange<F: Function>(
    commands: &Receiver<Came>,
    writer: &mut impl Write,
    port: &mut Port<F>,
    mut watch: impl FnMut(&mut Port<F>),
) -> Result<Ending, UsbIpError> {
    let (start, mut pump) = (Instant::now(), Pump::lagging(LAG_MAX));
    loop {
        let first = match commands.recv_timeout(pump.wait(start.elapsed())) {
            Ok(command) => Some(command),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => return Ok(Ending::HostLeft),
        };
        // A simulation that lags steps all the time: what came meanwhile has its turn too.
        for command in first.into_iter().chain(commands.try_iter().take(AHEAD)) {
            match command? {
                Some(Command::Submit(transfer)) => port.submit(transfer),
                Some(Command::Unlink { id, victim }) => {
                    let was_pending = port.unlink(victim);
                    // What has ended is said first: a client forgets what it has taken back.
                    answer(port, writer)?;
                    writer.write_all(&wire::unlinked(id, was_pending))?;
                }
                None => return Ok(Ending::HostLeft),
            }
            answer(port, writer)?;
        }
        if pump.step(start.elapsed()) {
            port.advance(STEP.as_secs_f64());
            watch(port);
        }
        answer(port, writer)?;
        let (count, bytes) = port.pending();
        if count > PENDING_MAX.0 || bytes > PENDING_MAX.1 {
            return Err(UsbIpError::Flood { count, bytes });
        }
        if !port.is_there() {
            return Ok(Ending::DeviceLeft);
        }
    }
}

/// Says what has ended.
fn answer<F: Function>(port: &mut Port<F>, writer: &mut impl Write) -> Result<(), UsbIpError> {
    while let Some(completion) = port.completed() {
        writer.write_all(&wire::submitted(&completion))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
