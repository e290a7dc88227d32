//! Frames that come as video: which of the turn those of the projector's count are, by their marks.

use crate::config::Config;
use crate::frames::Frames;
use crate::video_index::{Known, VideoIndex};

/// Each frame's mark, one after the other.
#[derive(Clone, Debug)]
pub(super) struct Video {
    frames: Frames,
    index: VideoIndex,
    /// By how much the numbers are ahead of the projector's count of frames.
    offset: u32,
    /// The last frame that was asked or told of, by its serial number, and what is known of it.
    last: Option<(u32, Known)>,
}

impl Video {
    /// Has seen no mark.
    pub(super) fn new(config: &Config) -> Self {
        let index = VideoIndex::new(&config.rotation);
        Self { frames: Frames::of(&config.rotation), index, offset: 0, last: None }
    }

    /// By how many frames of a turn the numbers are ahead of the projector's count of frames, as they were told last.
    pub(super) fn offset(&self) -> u32 {
        self.offset
    }

    /// Frame `serial`, which is `frame` in the projector's count, has this mark. Those before it of which nothing was told have none; what is
    /// told late or twice is not heard.
    #[inline(never)]
    pub(super) fn mark(&mut self, (serial, frame): (u32, u32), mark: Option<u32>) {
        let since = self.last.map_or(1, |(last, _)| serial.wrapping_sub(last) as i32);
        if since <= 0 {
            return;
        }
        // After a turn without marks nothing is known.
        (1..since.min(2 * self.frames.count() as i32)).for_each(|_| {
            self.index.frame(None);
        });
        let known = self.index.frame(mark);
        if let Known::Frame(number) = known {
            self.offset = self.frames.moved(number, -(frame as i32));
        }
        self.last = Some((serial, known));
    }

    /// What is known of frame `serial`, which begins next.
    pub(super) fn known(&mut self, (serial, frame): (u32, u32)) -> Known {
        self.mark((serial, frame), None);
        self.last.filter(|(last, _)| *last == serial).map_or(Known::Nothing, |(_, known)| known)
    }

    /// Whether the frame that was asked for last is one by the count alone.
    pub(super) fn is_doubtful(&self) -> bool {
        matches!(self.last, Some((_, Known::Doubtful(_))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::tests::example;
    use protocol::timing::Direction;

    /// Twelve frames a turn.
    fn video() -> Video {
        Video::new(&example(288, 240, Direction::Clockwise))
    }

    /// Frames `serials` come with marks that are 5 ahead of their count, which wraps.
    fn run(video: &mut Video, serials: impl Iterator<Item = u32>) {
        serials.for_each(|serial| video.mark((serial, serial % 12), Some((serial + 5) % 12)));
    }

    #[test]
    fn numbers_are_ahead_of_the_count() {
        let mut video = video();
        run(&mut video, 7..9);
        assert_eq!((video.known((8, 8)), video.offset()), (Known::Nothing, 0));
        run(&mut video, 9..11);
        assert_eq!((video.known((10, 10)), video.offset()), (Known::Frame(3), 5));
        // Told again, or of what is gone.
        video.mark((10, 10), Some(7));
        video.mark((9, 9), None);
        assert_eq!(video.known((10, 10)), Known::Frame(3));
    }

    #[test]
    fn frames_without_a_word_have_no_mark() {
        let mut video = video();
        run(&mut video, 0..6);
        assert_eq!(video.known((6, 6)), Known::Doubtful(11));
        assert!(video.is_doubtful());
        // Two more were not even asked for.
        video.mark((9, 9), Some(2));
        assert_eq!(video.known((9, 9)), Known::Frame(2));
        // After a long silence three marks must agree again.
        run(&mut video, 1_000_000..1_000_002);
        assert_eq!(video.known((1_000_001, 5)), Known::Nothing);
        run(&mut video, 1_000_002..1_000_003);
        assert_eq!(video.known((1_000_002, 6)), Known::Frame((1_000_002 + 5) % 12));
    }

    #[test]
    fn another_count_is_another_place() {
        let mut video = video();
        run(&mut video, 0..6);
        (6..9).for_each(|serial| video.mark((serial, serial), Some((serial + 4) % 12)));
        assert_eq!((video.known((8, 8)), video.offset()), (Known::Frame(0), 4));
    }
}
