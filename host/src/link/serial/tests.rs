use super::*;
use serialport::{SerialPort, TTYPort};
use std::io::{Read, Write};

/// A line whose far end is the test's.
fn line() -> (TTYPort, String, SerialLink) {
    let (far, near) = TTYPort::pair().unwrap();
    let path = near.name().unwrap();
    drop(near);
    let link = SerialLink::open(&path, 1_000_000).unwrap();
    (far, path, link)
}

#[test]
fn bytes_go_both_ways_as_they_are() {
    let (mut far, _, mut link) = line();
    let every: Vec<u8> = (0..=255).collect();
    assert_eq!(link.send(&every).unwrap(), 256);
    let mut heard = [0; 256];
    far.read_exact(&mut heard).unwrap();
    assert_eq!(heard[..], every);
    far.write_all(&every).unwrap();
    let mut said = vec![9];
    while said.len() < 257 {
        assert!(link.receive(&mut said, Duration::from_secs(10)).unwrap() > 0);
    }
    assert_eq!((said[0], &said[1..]), (9, &every[..]));
    assert_eq!(link.receive(&mut said, Duration::ZERO).unwrap(), 0);
    assert_eq!(link.bytes_per_second(), Some(100_000.0));
}

#[test]
fn a_full_line_takes_what_fits_and_does_not_wait() {
    let (mut far, _, mut link) = line();
    let bytes: Vec<u8> = (0..1 << 20).map(|at: u32| (at % 251) as u8).collect();
    let mut sent = 0;
    loop {
        let taken = link.send(&bytes[sent..]).unwrap();
        sent += taken;
        if taken == 0 {
            break;
        }
    }
    assert!((1..bytes.len()).contains(&sent), "{sent}");
    let mut heard = vec![0; sent];
    far.read_exact(&mut heard).unwrap();
    assert_eq!(heard, bytes[..sent]);
    assert!(link.send(&bytes[sent..]).unwrap() > 0);
}

#[test]
fn what_an_earlier_program_left_unread_is_gone() {
    let (mut far, path, link) = line();
    far.write_all(b"stale").unwrap();
    drop(link);
    let mut link = SerialLink::open(&path, 9_600).unwrap();
    assert_eq!(link.receive(&mut Vec::new(), Duration::ZERO).unwrap(), 0);
}

#[test]
fn a_port_has_one_user() {
    let (_far, path, link) = line();
    let error = SerialLink::open(&path, 1_000_000).unwrap_err();
    assert!(matches!(&error, LinkError::InUse { name } if *name == path), "{error}");
    drop(link);
    SerialLink::open(&path, 1_000_000).unwrap();
}

#[test]
fn a_port_that_vanishes_is_gone_after_its_last_bytes() {
    let (mut far, path, mut link) = line();
    far.write_all(b"last").unwrap();
    let mut said = Vec::new();
    while said.len() < 4 {
        link.receive(&mut said, Duration::from_secs(10)).unwrap();
    }
    drop(far);
    assert!(matches!(link.receive(&mut said, Duration::from_secs(10)), Err(LinkError::Gone)));
    assert!(matches!(link.send(b"more"), Err(LinkError::Gone)));
    assert_eq!(said, b"last");
    assert!(matches!(SerialLink::open(&path, 1_000_000), Err(LinkError::Absent { .. })));
}

#[test]
fn what_is_no_port_is_refused_with_a_remedy() {
    let absent = |path: &str| match SerialLink::open(path, 1_000_000) {
        Err(LinkError::Absent { name, remedy }) if name == path => remedy,
        other => panic!("{other:?}"),
    };
    assert!(absent("/dev/tty-of-nobody").contains("there is"));
    for (path, kind) in [("/tmp", "a folder"), ("/etc/passwd", "a file"), ("/dev/null", "a device")] {
        let Err(LinkError::Other { name, what, remedy }) = SerialLink::open(path, 1_000_000) else { panic!("{path}") };
        assert_eq!((&name[..], what), (path, &format!("{kind} and no serial port")[..]));
        assert!(remedy.contains("there is") != remedy.contains("plug"), "{remedy}");
    }
    let denied = refused("/dev/ttyS9", ErrorKind::PermissionDenied.into());
    assert!(matches!(&denied, LinkError::Forbidden { .. }) && denied.to_string().contains("dialout"), "{denied}");
    assert!(matches!(refused("/dev/ttyS9", ErrorKind::ResourceBusy.into()), LinkError::InUse { .. }));
    let dead = refused("/dev/ttyS9", io::Error::from_raw_os_error(line::GONE[0]));
    assert!(matches!(&dead, LinkError::Absent { .. }), "{dead}");
    assert_eq!(there_are(&["a".into(), "b".into()]), "there is a, b");
}
