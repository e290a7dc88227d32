//! Which vector instructions there are.

use super::block::{Block, Portable};
use core::fmt::{self, Display, Formatter};

/// Vector instructions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// What every machine of this kind has.
    Portable,
    /// 256 bits, x86-64-v3.
    Avx2,
    /// 512 bits with bytes and words, x86-64-v4.
    Avx512,
}

impl Level {
    /// All there are, the slowest first.
    pub const ALL: [Self; 3] = [Self::Portable, Self::Avx2, Self::Avx512];

    /// The best that this machine has.
    pub fn best() -> Self {
        Self::ALL.into_iter().rev().find(|level| level.is_available()).unwrap_or(Self::Portable)
    }

    /// Whether this machine has it.
    pub fn is_available(self) -> bool {
        match self {
            Self::Portable => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => {
                is_x86_feature_detected!("avx2")
                    && is_x86_feature_detected!("fma")
                    && is_x86_feature_detected!("bmi1")
                    && is_x86_feature_detected!("bmi2")
                    && is_x86_feature_detected!("lzcnt")
                    && is_x86_feature_detected!("popcnt")
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                Self::Avx2.is_available()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl")
            }
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx2 | Self::Avx512 => false,
        }
    }
}

/// Something to be done block by block, and with `N` triangles at once.
pub trait Work {
    /// Does it; to be `inline(always)`, so that it is compiled for the instructions of whoever runs it.
    fn run<B: Block, const N: usize>(self);
}

impl Level {
    /// Does `work` with these instructions, which this machine must have.
    pub fn run(self, work: impl Work) {
        assert!(self.is_available(), "this machine has no {self}");
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => x86::avx2(work),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => x86::avx512(work),
            _ => work.run::<Portable, 4>(),
        }
    }
}

/// The instructions are found by [`Level::is_available`], which [`Level::run`] asks before it comes here.
#[cfg(target_arch = "x86_64")]
mod x86 {
    #![allow(unsafe_code)]
    use super::super::block::x86::{Avx2, Avx512};
    use super::Work;

    pub(super) fn avx2(work: impl Work) {
        #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
        fn with(work: impl Work) {
            work.run::<Avx2, 16>();
        }
        // SAFETY: the machine has them.
        unsafe { with(work) }
    }

    pub(super) fn avx512(work: impl Work) {
        #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
        fn with(work: impl Work) {
            work.run::<Avx512, 16>();
        }
        // SAFETY: the machine has them.
        unsafe { with(work) }
    }
}

impl Display for Level {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Portable => "portable",
            Self::Avx2 => "AVX2",
            Self::Avx512 => "AVX-512",
        })
    }
}
