use super::*;
use std::sync::mpsc::{Receiver, channel};

/// Longer than anything here takes on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);

type Arrivals = Receiver<Result<Reading, ParseError>>;

fn followed(source: &TrackerSource) -> (Follower, Arrivals) {
    let (sender, arrivals) = channel();
    let follower = Follower::start(source, 2, Instant::now(), move |arrived| drop(sender.send(arrived))).unwrap();
    (follower, arrivals)
}

/// Waits until `follower`'s state is one that `is`.
fn until<T>(follower: &Follower, is: impl Fn(State) -> Option<T>) -> T {
    let end = Instant::now() + PATIENCE;
    while Instant::now() < end {
        if let Some(found) = is(follower.state()) {
            return found;
        }
        thread::sleep(Duration::from_millis(5));
    }
    panic!("{:?}", follower.state());
}

fn open(state: State) -> Option<String> {
    if let State::Open(place) = state { Some(place) } else { None }
}

fn closed(state: State) -> Option<String> {
    if let State::Closed(why) = state { Some(why) } else { None }
}

#[test]
fn datagrams_become_readings() {
    let loopback = SocketAddr::from(([127, 0, 0, 1], 0));
    let (follower, arrivals) = followed(&TrackerSource::Opentrack(loopback));
    let address = until(&follower, open);
    let sender = UdpSocket::bind(loopback).unwrap();
    let packet: Vec<u8> = [10.0f64, 20.0, 30.0, 0.0, 0.0, 0.0].iter().flat_map(|number| number.to_le_bytes()).collect();
    for bytes in [&packet[..], &[0; 3000], &[], &packet] {
        sender.send_to(bytes, &address).unwrap();
    }
    let first = arrivals.recv_timeout(PATIENCE).unwrap().unwrap();
    assert_eq!((first.viewer, first.position_m), (0x200, glam::DVec3::new(0.1, 0.2, 0.3)));
    for bytes in [DATAGRAM_BYTES, 0] {
        let refused = arrivals.recv_timeout(PATIENCE).unwrap().unwrap_err();
        assert!(matches!(refused, ParseError::Length { found, .. } if found == bytes), "{refused}");
    }
    assert!(arrivals.recv_timeout(PATIENCE).unwrap().unwrap().at > first.at);
    // Silence closes nothing.
    thread::sleep(3 * LOOK);
    assert_eq!(open(follower.state()), Some(address.clone()));
    sender.send_to(&packet, &address).unwrap();
    arrivals.recv_timeout(PATIENCE).unwrap().unwrap();
    // The port is taken; when it is free again, it is found.
    let taken = TrackerSource::FreeD(address.parse().unwrap());
    let (second, arrivals) = followed(&taken);
    let why = until(&second, |state| closed(state).filter(|why| why.contains("another program")));
    assert!(why.starts_with("freed:") && why.lines().count() == 1, "{why}");
    drop(follower);
    assert_eq!(until(&second, open), address);
    drop(second);
    assert!(arrivals.recv().is_err(), "the thread has ended");
}

#[cfg(unix)]
mod serial {
    use super::*;
    use serialport::{SerialPort, TTYPort};
    use std::io::{Read, Write};
    use std::path::Path;

    const LINE: &str = "02    10.00  20.00  30.00   0.00   0.00   0.00\r\n";

    /// The device's end of a pseudo-terminal, whose other end has the name `port`.
    fn device(port: &Path) -> TTYPort {
        let (mut device, near) = TTYPort::pair().unwrap();
        device.set_timeout(PATIENCE).unwrap();
        let _ = std::fs::remove_file(port);
        std::os::unix::fs::symlink(near.name().unwrap(), port).unwrap();
        device
    }

    #[test]
    fn a_patriot_is_told_what_to_do_and_found_again() {
        let folder = tempfile::tempdir().unwrap();
        let port = folder.path().join("port");
        let source = TrackerSource::Patriot { port: port.to_str().unwrap().into(), baud: 115_200 };
        let (follower, arrivals) = followed(&source);
        until(&follower, |state| closed(state).filter(|why| why.contains("no device")));
        for round in 0..2 {
            let mut device = device(&port);
            // A port that nobody has opened yet has hung up.
            until(&follower, open);
            let mut told = [0; COMMANDS.len()];
            device.read_exact(&mut told).unwrap();
            assert_eq!(told, COMMANDS);
            if round == 0 {
                // It is silent: told again.
                device.read_exact(&mut told).unwrap();
                assert_eq!(told, COMMANDS);
            }
            // Two lines at once have times of their own.
            device.write_all(format!("rest of a line\r\n{LINE}{LINE}").as_bytes()).unwrap();
            let [first, second] = [0; 2].map(|_| arrivals.recv_timeout(PATIENCE).unwrap().unwrap());
            assert_eq!((first.viewer, first.position_m), (0x202, glam::DVec3::new(0.1, 0.2, 0.3)));
            assert!(second.at > first.at);
            // Unplugged.
            drop(device);
            until(&follower, closed);
        }
    }
}
