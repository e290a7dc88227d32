use super::*;
use crate::frame_store::Heap;
use crate::motor::Motor;
use crate::scenario::Scenario;
use crate::world::World;
use firmware::controller::Controller;
use firmware::lockstep::{self, FRAME_BYTES_MAX, Gauge, Session};
use protocol::timing::{Direction, Rotation};
use protocol::units::Turns;
use std::io::{Read, Write};
use std::thread::JoinHandle;

/// What an image does after so many frames.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Trouble {
    None,
    HangsUp,
    IsSilent,
    TalksNonsense,
    ForgetsItself,
}

const FRAMES_BEFORE: usize = 2_000;

struct NoGauge;

impl Gauge for NoGauge {
    fn count<T>(&mut self, step: impl FnOnce() -> T) -> (T, u32) {
        (step(), 8)
    }

    fn stack_bytes(&self) -> u32 {
        0
    }

    fn thousand(&mut self) -> u32 {
        1_600
    }
}

/// An image on this machine, that gets into `trouble`.
fn stand_in(trouble: Trouble) -> (TcpStream, JoinHandle<()>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let near = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
    let (mut far, _) = listener.accept().unwrap();
    far.set_nodelay(true).unwrap();
    let run = move || {
        let (mut session, mut frames) = (Session::new(Heap::default()), 0);
        let mut head = [0; 18];
        while far.read_exact(&mut head).is_ok() {
            let mut payload = vec![0; usize::from(head[3]) - 14];
            far.read_exact(&mut payload).unwrap();
            let (serial, request) = lockstep::read(&payload).unwrap();
            let mut answer = session.answer(&request, &mut NoGauge);
            frames += 1;
            match trouble {
                _ if frames < FRAMES_BEFORE => {}
                Trouble::None => {}
                Trouble::HangsUp => return,
                Trouble::IsSilent => continue,
                Trouble::TalksNonsense => {
                    far.write_all(&[
                        0, 0, 0, 20, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 200, 200, 200, 200, 200, 200,
                    ])
                    .unwrap();
                    continue;
                }
                Trouble::ForgetsItself => answer = Answer::Refused,
            }
            let mut out = [0; FRAME_BYTES_MAX];
            let out = lockstep::write(serial, &answer, &mut out).unwrap();
            head[3] = out.len() as u8 + 14;
            far.write_all(&[&head[..], out].concat()).unwrap();
        }
    };
    (near, std::thread::spawn(run))
}

fn rotation() -> Rotation {
    Rotation::new(288, 24, 240_000_000, Turns::ZERO, Direction::CounterClockwise).unwrap()
}

fn config() -> Config {
    Motor::reference().firmware_config(&rotation(), Nanos::ZERO)
}

/// A quarter of a second with an image that gets into `trouble` after a fifth: the world, and why the image failed.
fn world_with(trouble: Trouble) -> (World, Option<String>) {
    let (cable, _) = stand_in(trouble);
    let mut image = Image::over(cable, Duration::from_millis(300)).unwrap();
    image.begin(&config()).unwrap();
    let image = SharedImage::new(image);
    let motor = Motor::reference();
    let mut world =
        World::with_core(&rotation(), Nanos::ZERO, &motor, &Scenario::default(), 3, Box::new(image.clone()));
    world.advance(0.25);
    let failure = image.lock().failure().map(ToString::to_string);
    (world, failure)
}

#[test]
fn an_image_in_trouble_leaves_the_mirror_dark_and_without_torque() {
    let (healthy, failure) = world_with(Trouble::None);
    assert_eq!((healthy.state(), failure), (State::SpinUp, None));
    for (trouble, told) in [
        (Trouble::HangsUp, "the image hung up"),
        (Trouble::IsSilent, "the image has not answered for 0.3 s"),
        (Trouble::TalksNonsense, "the image answered with [c8, c8"),
        (Trouble::ForgetsItself, "the image answered Refused"),
    ] {
        let (world, failure) = world_with(trouble);
        assert_eq!(world.state(), State::Fault, "{trouble:?}");
        // The world goes on, and friction slows the mirror down.
        assert!(world.true_speed() < healthy.true_speed(), "{trouble:?}");
        let failure = failure.unwrap();
        assert!(failure.starts_with(told), "{trouble:?}: {failure}");
    }
}

#[test]
fn a_stand_in_answers_as_the_native_core_does() {
    let (cable, _) = stand_in(Trouble::None);
    let mut image = Image::over(cable, Duration::from_secs(5)).unwrap();
    image.begin(&config()).unwrap();
    let mut native = Controller::new(config()).unwrap();
    for ms in 0..50 {
        let (now, input) = (Nanos(ms * 1_000_000), Input::Tick { encoder_count: ms as u32 });
        assert_eq!(image.step(now, input).unwrap(), native.step(now, input));
    }
    assert_eq!(image.estimates().unwrap(), native.estimates());
    assert_eq!(image.thousand().unwrap(), 1_000);
    // 8 ticks of 40 ns, an instruction lasting 64 ns.
    assert_eq!(image.costs().kinds()[0].instructions, 5);
    let mut impossible = config();
    impossible.control_rate_hz = 0.0;
    assert!(matches!(image.begin(&impossible), Err(ImageError::Config(_))));
}

#[test]
fn what_is_no_image_is_named() {
    let missing = Image::boot(Path::new("nowhere/mps2")).unwrap_err().to_string();
    assert!(missing.starts_with("nowhere/mps2: no such image: build it"), "{missing}");
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let near = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
    let answer = std::thread::spawn(move || {
        let (mut far, _) = listener.accept().unwrap();
        let mut request = [0; 20];
        far.read_exact(&mut request).unwrap();
        let mut out = [0; FRAME_BYTES_MAX];
        let out = lockstep::write(1, &Answer::Hello(VERSION + 1), &mut out).unwrap();
        far.write_all(&[&[0, 0, 0, 14 + out.len() as u8][..], &[0; 14], out].concat()).unwrap();
    });
    let error = Image::over(near, Duration::from_secs(5)).unwrap_err();
    assert!(matches!(error, ImageError::Version(version) if version == VERSION + 1), "{error}");
    answer.join().unwrap();
}
