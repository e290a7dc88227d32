//! A monitor of an X server: found, examined, and given frames.

use super::VideoError;
use super::fit::{Found, Mode, Property, check};
use super::pace::Due;
use protocol::rig::Rig;
use std::collections::VecDeque;
use std::fmt::Display;
use std::time::{Duration, Instant};
use x11rb::NONE;
use x11rb::connection::{Connection as _, RequestConnection as _};
use x11rb::protocol::Event;
use x11rb::protocol::present::{self, CompleteKind, CompleteMode, EventMask};
use x11rb::protocol::randr::{self, ConnectionExt as _};
use x11rb::protocol::screensaver;
use x11rb::protocol::xproto::{
    self, AtomEnum, ConnectionExt as _, CreateGCAux, CreateWindowAux, ImageFormat, ImageOrder, PropMode, Screen,
};
use x11rb::rust_connection::RustConnection;
use x11rb::wrapper::ConnectionExt as _;

/// A server that says nothing for so long has lost its monitor.
const SILENCE: Duration = Duration::from_secs(3);
/// Refreshes by which a rate is measured that the driver does not tell. A server without a monitor counts them by rounding its time, so
/// that the rate may be wrong by one of them.
const MEASURED: u64 = 150;
/// So many of them at once, for which nobody waits in vain for long.
const MEASURED_AT_ONCE: usize = 50;

fn lost(error: impl Display) -> VideoError {
    VideoError::Lost(error.to_string())
}

/// What the server said.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Said {
    /// The frame of this serial number is on screen since refresh `at`; none: it was left out.
    Shown {
        /// As [`Due::serial`] named it.
        serial: u32,
        /// The refresh.
        at: Option<u64>,
        /// Whether it was copied to the screen, where it may tear; otherwise the screen was switched over to it.
        copied: bool,
    },
    /// Something else lies above the picture.
    Covered,
}

/// A monitor that fits.
pub struct Monitor {
    server: RustConnection,
    screen: Screen,
    crtc: randr::Crtc,
    place: [i16; 2],
    size: [u16; 2],
    /// What may change bits, in words.
    pub doubts: Vec<String>,
    /// Refreshes a second.
    pub refresh_hz: f64,
}

impl Monitor {
    /// The monitors of the display, each with its size and rate.
    pub fn there() -> Result<Vec<String>, VideoError> {
        let (server, screen) = connect()?;
        match (Ask { server: &server, screen: &screen }).monitor("?") {
            Err(VideoError::NoMonitor { there, .. }) => Ok(there),
            other => other.map(|_| Vec::new()),
        }
    }

    /// The monitor of this name, if frames of `rig` are shown on it as they are.
    pub fn find(name: &str, rig: &Rig) -> Result<Self, VideoError> {
        let (server, screen) = connect()?;
        let ask = Ask { server: &server, screen: &screen };
        let (crtc, mut found) = ask.monitor(name)?;
        if found.mode.refresh_hz.is_none() {
            let hz = ask.measured_hz()?;
            found.mode.refresh_hz = Some(hz);
            found
                .modes
                .iter_mut()
                .filter(|mode| mode.size == found.mode.size)
                .for_each(|mode| mode.refresh_hz = Some(hz));
        }
        let doubts = check(&found, rig)?;
        let info = server.randr_get_crtc_info(crtc, 0).map_err(lost)?.reply().map_err(lost)?;
        let (place, size) = ([info.x, info.y], [info.width, info.height]);
        Ok(Self { server, screen, crtc, place, size, doubts, refresh_hz: found.mode.refresh_hz.unwrap_or_default() })
    }

    /// A window that is all of the monitor, dark, above everything else; and the refresh that is shown now. `ahead`: frames that may be on their way.
    pub fn open(self, ahead: u32) -> Result<(Window, u64), VideoError> {
        let pixmaps = ahead + 3; // One on screen, one that leaves it, one that is being filled.
        let window = Window::new(self, pixmaps).map_err(lost)?;
        let now = await_msc(&window.monitor.server, window.window, 0)?.1;
        Ok((window, now))
    }
}

/// The server of DISPLAY, and its screen.
fn connect() -> Result<(RustConnection, Screen), VideoError> {
    let (server, number) = RustConnection::connect(None).map_err(|error| VideoError::NoDisplay(error.to_string()))?;
    for (extension, called) in [(randr::X11_EXTENSION_NAME, "RandR"), (present::X11_EXTENSION_NAME, "Present")] {
        if server.extension_information(extension).map_err(lost)?.is_none() {
            return Err(VideoError::NoExtension(called));
        }
    }
    randr::query_version(&server, 1, 3).map_err(lost)?.reply().map_err(lost)?;
    present::query_version(&server, 1, 0).map_err(lost)?.reply().map_err(lost)?;
    let screen = server.setup().roots[number].clone();
    Ok((server, screen))
}

/// Questions to a server.
struct Ask<'a> {
    server: &'a RustConnection,
    screen: &'a Screen,
}

type Replied<T> = Result<T, VideoError>;

impl Ask<'_> {
    fn monitor(&self, name: &str) -> Replied<(randr::Crtc, Found)> {
        let resources = self.server.randr_get_screen_resources_current(self.screen.root);
        let resources = resources.map_err(lost)?.reply().map_err(lost)?;
        let mut there = Vec::new();
        for output in &resources.outputs {
            let info = self.server.randr_get_output_info(*output, 0).map_err(lost)?.reply().map_err(lost)?;
            let called = String::from_utf8_lossy(&info.name).into_owned();
            if info.crtc == NONE {
                if info.connection == randr::Connection::CONNECTED {
                    there.push(format!("{called} (off: xrandr --output {called} --auto)"));
                }
                continue;
            }
            let crtc = self.server.randr_get_crtc_info(info.crtc, 0).map_err(lost)?.reply().map_err(lost)?;
            let mode_of = |id: &u32| resources.modes.iter().find(|mode| mode.id == *id).map(mode_of);
            let mode =
                mode_of(&crtc.mode).unwrap_or(Mode { size: [crtc.width.into(), crtc.height.into()], refresh_hz: None });
            if called != name {
                there.push(format!("{called} {mode}"));
                continue;
            }
            let modes = info.modes.iter().filter_map(mode_of).collect();
            return Ok((info.crtc, self.found(name, mode, modes, *output, (info.crtc, &crtc))?));
        }
        Err(VideoError::NoMonitor { name: name.into(), there })
    }

    fn found(
        &self,
        name: &str,
        mode: Mode,
        modes: Vec<Mode>,
        output: randr::Output,
        (crtc, info): (randr::Crtc, &randr::GetCrtcInfoReply),
    ) -> Replied<Found> {
        let gamma = self.server.randr_get_crtc_gamma(crtc).map_err(lost)?.reply().map_err(lost)?;
        let transform = self.server.randr_get_crtc_transform(crtc).map_err(lost)?.reply().map_err(lost)?;
        let is_xwayland = self.server.query_extension(b"XWAYLAND").map_err(lost)?.reply().map_err(lost)?.present;
        Ok(Found {
            name: name.into(),
            mode,
            modes,
            depth: self.screen.root_depth,
            is_bgrx: self.is_bgrx(),
            gamma: [gamma.red, gamma.green, gamma.blue],
            is_rotated: info.rotation != randr::Rotation::ROTATE0,
            is_transformed: !is_identity(&transform.current_transform),
            is_xwayland,
            properties: self.properties(output)?,
        })
    }

    fn is_bgrx(&self) -> bool {
        let setup = self.server.setup();
        let formats = setup.pixmap_formats.iter();
        let is_of_four_bytes =
            |format: &&xproto::Format| format.depth == self.screen.root_depth && format.bits_per_pixel == 32;
        let visuals = self.screen.allowed_depths.iter().flat_map(|depth| &depth.visuals);
        let is_usual = |visual: &xproto::Visualtype| {
            visual.visual_id == self.screen.root_visual
                && visual.class == xproto::VisualClass::TRUE_COLOR
                && [visual.red_mask, visual.green_mask, visual.blue_mask] == [0xFF_0000, 0xFF00, 0xFF]
        };
        setup.image_byte_order == ImageOrder::LSB_FIRST
            && formats.clone().any(|format| is_of_four_bytes(&format))
            && visuals.into_iter().any(is_usual)
    }

    fn properties(&self, output: randr::Output) -> Replied<Vec<(String, Property)>> {
        let atoms = self.server.randr_list_output_properties(output).map_err(lost)?.reply().map_err(lost)?.atoms;
        let read = |atom: xproto::Atom| {
            let ask = self.server.randr_get_output_property(output, atom, AtomEnum::ANY, 0, 64, false, false);
            let value = ask.map_err(lost)?.reply().map_err(lost)?;
            let numbers = match value.format {
                8 => value.data.iter().map(|byte| u32::from(*byte)).collect(),
                32 => value.data.as_chunks().0.iter().map(|bytes| u32::from_ne_bytes(*bytes)).collect(),
                _ => Vec::new(),
            };
            let value = match numbers.first() {
                Some(name) if value.type_ == u32::from(AtomEnum::ATOM) => Property::Name(self.name(*name)?),
                _ => Property::Numbers(numbers),
            };
            Ok((self.name(atom)?, value))
        };
        atoms.into_iter().map(read).collect()
    }

    fn name(&self, atom: xproto::Atom) -> Replied<String> {
        let name = self.server.get_atom_name(atom).map_err(lost)?.reply().map_err(lost)?.name;
        Ok(String::from_utf8_lossy(&name).into_owned())
    }

    /// Refreshes a second, by the server's own clock.
    fn measured_hz(&self) -> Replied<f64> {
        let window = self.server.generate_id().map_err(lost)?;
        let (root, none) = (self.screen.root, CreateWindowAux::new());
        let class = xproto::WindowClass::INPUT_OUTPUT;
        self.server.create_window(0, window, root, 0, 0, 1, 1, 0, class, 0, &none).map_err(lost)?;
        select(self.server, window).map_err(lost)?;
        let (began_us, first) = await_msc(self.server, window, 0)?;
        let (mut ended_us, mut last) = (began_us, first);
        for target in (first..=first + MEASURED).step_by(MEASURED_AT_ONCE) {
            (ended_us, last) = await_msc(self.server, window, target)?;
        }
        self.server.destroy_window(window).map_err(lost)?;
        Ok((last - first) as f64 * 1e6 / ended_us.saturating_sub(began_us).max(1) as f64)
    }
}

fn mode_of(mode: &randr::ModeInfo) -> Mode {
    let size = [mode.width, mode.height].map(u32::from);
    let dots = f64::from(mode.htotal) * f64::from(mode.vtotal);
    let has = |flag| u32::from(mode.mode_flags) & u32::from(flag) != 0;
    let fields = if has(randr::ModeFlag::INTERLACE) { 2.0 } else { 1.0 };
    let scans = if has(randr::ModeFlag::DOUBLE_SCAN) { 2.0 } else { 1.0 };
    let refresh_hz = (mode.dot_clock > 0 && dots > 0.0).then(|| f64::from(mode.dot_clock) * fields / scans / dots);
    Mode { size, refresh_hz }
}

fn is_identity(transform: &x11rb::protocol::render::Transform) -> bool {
    let t = transform;
    let one = 1 << 16;
    [t.matrix11, t.matrix12, t.matrix13, t.matrix21, t.matrix22, t.matrix23, t.matrix31, t.matrix32, t.matrix33]
        == [one, 0, 0, 0, one, 0, 0, 0, one]
}

fn select(server: &RustConnection, window: xproto::Window) -> Result<(), x11rb::errors::ReplyOrIdError> {
    let events = EventMask::COMPLETE_NOTIFY | EventMask::IDLE_NOTIFY;
    present::select_input(server, server.generate_id()?, window, events)?;
    Ok(())
}

/// The next event, for at most `time`.
fn next_event(server: &RustConnection, time: Duration) -> Replied<Option<Event>> {
    server.flush().map_err(lost)?;
    let end = Instant::now() + time;
    loop {
        if let Some(event) = server.poll_for_event().map_err(lost)? {
            return Ok(Some(event));
        }
        let left = end.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Ok(None);
        }
        await_input(server, left)?;
    }
}

#[cfg(unix)]
fn await_input(server: &RustConnection, time: Duration) -> Replied<()> {
    use rustix::event::{PollFd, PollFlags, Timespec, poll};
    let time = Timespec { tv_sec: time.as_secs() as _, tv_nsec: time.subsec_nanos().into() };
    match poll(&mut [PollFd::new(server.stream(), PollFlags::IN)], Some(&time)) {
        Ok(_) | Err(rustix::io::Errno::INTR) => Ok(()),
        Err(error) => Err(lost(error)),
    }
}

#[cfg(not(unix))]
fn await_input(_server: &RustConnection, time: Duration) -> Replied<()> {
    std::thread::sleep(time.min(Duration::from_millis(1)));
    Ok(())
}

/// Waits for refresh `target`, or for an answer at once where it is over: the time in microseconds and the refresh.
fn await_msc(server: &RustConnection, window: xproto::Window, target: u64) -> Replied<(u64, u64)> {
    present::notify_msc(server, window, 0, target, 0, 0).map_err(lost)?;
    loop {
        match next_event(server, SILENCE)? {
            Some(Event::PresentCompleteNotify(event)) if event.kind == CompleteKind::NOTIFY_MSC => {
                return Ok((event.ust, event.msc));
            }
            Some(Event::Error(error)) => return Err(lost(format!("{error:?}"))),
            Some(_) => {}
            None => return Err(VideoError::Silent(SILENCE.as_secs())),
        }
    }
}

/// The picture on a monitor.
pub struct Window {
    monitor: Monitor,
    window: xproto::Window,
    context: xproto::Gcontext,
    free: VecDeque<xproto::Pixmap>,
}

impl Window {
    fn new(monitor: Monitor, pixmaps: u32) -> Result<Self, x11rb::errors::ReplyOrIdError> {
        let Monitor { server, screen, place: [x, y], size: [width, height], .. } = &monitor;
        let (root, depth) = (screen.root, screen.root_depth);
        let (window, context, cursor) = (server.generate_id()?, server.generate_id()?, server.generate_id()?);
        let blank = server.generate_id()?;
        server.create_pixmap(1, blank, root, 1, 1)?;
        server.create_cursor(cursor, blank, blank, 0, 0, 0, 0, 0, 0, 0, 0)?;
        // No window manager has a say in it.
        let wanted = CreateWindowAux::new()
            .override_redirect(1)
            .background_pixel(screen.black_pixel)
            .cursor(cursor)
            .event_mask(xproto::EventMask::VISIBILITY_CHANGE);
        let class = xproto::WindowClass::INPUT_OUTPUT;
        server.create_window(depth, window, root, *x, *y, *width, *height, 0, class, screen.root_visual, &wanted)?;
        let bypass = server.intern_atom(false, b"_NET_WM_BYPASS_COMPOSITOR")?.reply()?.atom;
        server.change_property32(PropMode::REPLACE, window, bypass, AtomEnum::CARDINAL, &[1])?;
        server.create_gc(context, window, &CreateGCAux::new().graphics_exposures(0))?;
        let mut free = VecDeque::new();
        for _ in 0..pixmaps {
            let pixmap = server.generate_id()?;
            server.create_pixmap(depth, pixmap, window, *width, *height)?;
            free.push_back(pixmap);
        }
        select(server, window)?;
        randr::select_input(server, root, randr::NotifyMask::CRTC_CHANGE | randr::NotifyMask::OUTPUT_CHANGE)?;
        if server.extension_information(screensaver::X11_EXTENSION_NAME)?.is_some() {
            screensaver::query_version(server, 1, 1)?.reply()?;
            screensaver::suspend(server, 1)?;
        }
        // Pressed keys and buttons go where they went; the pointer is out of sight above this window alone.
        server.map_window(window)?;
        server.flush()?;
        Ok(Self { window, context, free, monitor })
    }

    /// The monitor.
    pub fn monitor(&self) -> &Monitor {
        &self.monitor
    }

    /// Whether the server has given back enough to take another frame.
    pub fn has_room(&self) -> bool {
        !self.free.is_empty()
    }

    /// Hands a frame over: `bytes` as [`bytes_of`](super::bytes_of) makes them.
    pub fn show(&mut self, due: &Due, bytes: &[u8]) -> Result<(), VideoError> {
        let Some(pixmap) = self.free.pop_front() else { return Ok(()) };
        self.put(pixmap, bytes)?;
        let server = &self.monitor.server;
        present::pixmap(
            server,
            self.window,
            pixmap,
            due.serial(),
            NONE,
            NONE,
            0,
            0,
            self.monitor.crtc,
            NONE,
            NONE,
            present::Option::NONE.into(),
            due.target,
            0,
            0,
            &[],
        )
        .map_err(lost)?;
        server.flush().map_err(lost)
    }

    fn put(&self, pixmap: xproto::Pixmap, bytes: &[u8]) -> Result<(), VideoError> {
        let Monitor { server, screen, size: [width, _], .. } = &self.monitor;
        let line = usize::from(*width) * 4;
        // Servers take 16 MB in one request; all take a line.
        let lines = (server.maximum_request_bytes().saturating_sub(64) / line).max(1);
        for (part, rows) in bytes.chunks(lines * line).enumerate() {
            let (y, height) = ((part * lines) as i16, (rows.len() / line) as u16);
            let depth = screen.root_depth;
            server
                .put_image(ImageFormat::Z_PIXMAP, pixmap, self.context, *width, height, 0, y, 0, depth, rows)
                .map_err(lost)?;
        }
        Ok(())
    }

    /// What the server says next, all of it; waits for `time` at most, and not for things that are of no interest here.
    pub fn listen(&mut self, time: Duration) -> Result<Vec<Said>, VideoError> {
        let mut said = Vec::new();
        let mut event = next_event(&self.monitor.server, time)?;
        while let Some(heard) = event {
            self.take(heard, &mut said)?;
            event = self.monitor.server.poll_for_event().map_err(lost)?;
        }
        Ok(said)
    }

    fn take(&mut self, event: Event, said: &mut Vec<Said>) -> Result<(), VideoError> {
        match event {
            Event::PresentCompleteNotify(event) if event.kind == CompleteKind::PIXMAP => said.push(Said::Shown {
                serial: event.serial,
                at: (event.mode != CompleteMode::SKIP).then_some(event.msc),
                copied: matches!(event.mode, CompleteMode::COPY | CompleteMode::SUBOPTIMAL_COPY),
            }),
            Event::PresentIdleNotify(event) => self.free.push_back(event.pixmap),
            Event::VisibilityNotify(event) if event.state != xproto::Visibility::UNOBSCURED => said.push(Said::Covered),
            Event::RandrNotify(_) => return Err(VideoError::Changed),
            Event::Error(error) => return Err(lost(format!("{error:?}"))),
            _ => {}
        }
        Ok(())
    }
}
