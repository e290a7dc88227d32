//! Frames that come as video, on their way from a host over a graphics card and a link to the lock onto their numbers, with everything going wrong.

use firmware::video_index::{AGREEING, Known, VideoIndex};
use proptest::prelude::*;
use protocol::frame_mark::{PIXELS, SIDE, pixel, read};
use protocol::timing::{Direction, Rotation};
use protocol::units::Turns;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// What goes wrong with a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    /// A bit of the mark arrives the other way.
    Bit,
    /// The whole mark arrives as another, whole one: what no link is known to do.
    Mark(u32),
    /// The card shows the frame before it once more, and the host catches up with the next.
    Late,
    /// The card shows the frame before it once more, and all that follow come one later.
    Repeated,
    /// The card leaves the frame out.
    Dropped,
    /// The host begins anew after so many frames of a desktop, with another first frame.
    Restart { gap: u32, first: u32 },
}

/// From a host to the projector: which frame is on screen, and the pixels where its mark is.
struct Video {
    frames: u32,
    /// The frame that the host has for the next refresh.
    next: u32,
    on_screen: Option<u32>,
    gap: u32,
    random: ChaCha8Rng,
}

impl Video {
    fn refresh(&mut self, fault: Option<Fault>) -> [u32; PIXELS] {
        let mut is_shown_again = false;
        match fault {
            Some(Fault::Late) => is_shown_again = true,
            Some(Fault::Repeated) => (is_shown_again, self.next) = (true, self.next + self.frames - 1),
            Some(Fault::Dropped) => self.next += 1,
            Some(Fault::Restart { gap, first }) => {
                (self.gap, self.next) = (gap, first + self.frames - gap % self.frames)
            }
            Some(Fault::Bit | Fault::Mark(_)) | None => {}
        }
        if self.gap > 0 {
            (self.gap, self.on_screen) = (self.gap - 1, None);
        } else if !is_shown_again {
            self.on_screen = Some(self.next % self.frames);
        }
        self.next = (self.next + 1) % self.frames;
        let mark = |frame| std::array::from_fn(|place| pixel(frame, place as u32 % SIDE, place as u32 / SIDE));
        let mut pixels = self.on_screen.map_or([0x30_40_50; PIXELS], mark);
        match fault {
            Some(Fault::Bit) => pixels[self.random.random_range(0..PIXELS)] ^= 1 << self.random.random_range(0..24),
            Some(Fault::Mark(frame)) => pixels = mark(frame),
            _ => {}
        }
        pixels
    }
}

/// A fault now and then, often several close together, but never a false mark beside another fault: two that happen to agree are beyond
/// any count of frames.
fn faults() -> impl Strategy<Value = Vec<(u32, Fault)>> {
    let fault = prop_oneof![
        3 => Just(Fault::Bit),
        1 => (0u32..4_096).prop_map(Fault::Mark),
        2 => Just(Fault::Late),
        2 => Just(Fault::Repeated),
        2 => Just(Fault::Dropped),
        1 => (0u32..60, 0u32..170).prop_map(|(gap, first)| Fault::Restart { gap, first }),
    ];
    let quiet = prop_oneof![3 => 1u32..4, 1 => 4u32..60];
    prop::collection::vec((quiet, fault), 0..40).prop_map(|mut faults| {
        for place in 0..faults.len() {
            let before = place.checked_sub(1).map(|before| faults[before].1);
            if let (Fault::Mark(_), _) | (_, Some(Fault::Mark(_))) = (faults[place].1, before) {
                let gap = if let Some(Fault::Restart { gap, .. }) = before { gap } else { 0 };
                faults[place].0 += gap + AGREEING + 1;
            }
        }
        faults
    })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(2_000) })]

    /// Whatever happens, no frame is known as another one than is on screen; a lost or false mark and a late frame cost their own frame; and
    /// after anything else the count is known again three frames after it is over.
    #[test]
    fn no_frame_is_taken_for_another(frames in 3u32..=170, first in 0u32..170, faults in faults(), seed: u64) {
        let rotation = Rotation::new(24 * frames, 24, 240_000_000, Turns::ZERO, Direction::CounterClockwise).unwrap();
        let mut index = VideoIndex::new(&rotation);
        let random = ChaCha8Rng::seed_from_u64(seed);
        let mut video = Video { frames, next: first % frames, on_screen: None, gap: 0, random };
        // Frames with a mark that counts on from the one before: so many have come in a row.
        let (mut before, mut in_order) = (None, 0);
        let (mut is_locked, mut dark) = (false, 0);
        let quiet = |gap: u32| std::iter::repeat_n(None, gap as usize);
        for fault in faults.into_iter().flat_map(|(gap, fault)| quiet(gap).chain([Some(fault)])).chain(quiet(80)) {
            let mark = read(&video.refresh(fault));
            let is_next = before.is_some_and(|before: u32| video.on_screen == Some((before + 1) % frames));
            let is_told = video.on_screen.is_some() && mark == video.on_screen;
            in_order = if !is_told { 0 } else if is_next { in_order + 1 } else { 1 };
            before = video.on_screen;
            let known = index.frame(mark);
            match known {
                Known::Frame(number) => prop_assert_eq!(Some(number), video.on_screen),
                Known::Doubtful(_) => prop_assert!(is_locked),
                Known::Nothing => {}
            }
            let is_lit = matches!(known, Known::Frame(_));
            prop_assert!(is_lit || in_order < AGREEING, "dark though {in_order} marks agree");
            (is_locked, dark) = (is_locked || is_lit, if is_lit { 0 } else { dark + 1 });
        }
        prop_assert_eq!(dark, 0);
    }

    /// A mark that is lost, and a frame that the host makes good, cost one frame and not the lock.
    #[test]
    fn what_the_host_makes_good_costs_one_frame(frames in 3u32..=170, bad in prop::sample::select(vec![Fault::Bit, Fault::Late])) {
        let rotation = Rotation::new(24 * frames, 24, 240_000_000, Turns::ZERO, Direction::CounterClockwise).unwrap();
        let mut index = VideoIndex::new(&rotation);
        let mut video = Video { frames, next: 0, on_screen: None, gap: 0, random: ChaCha8Rng::seed_from_u64(1) };
        let mut lit = |fault| matches!(index.frame(read(&video.refresh(fault))), Known::Frame(_));
        (0..AGREEING).for_each(|_| { lit(None); });
        prop_assert!(!lit(Some(bad)) && (0..10).all(|_| lit(None)));
    }
}
