//! Whose images run here.

use protocol::image::Board;
use update::image::Owner;

/// 32 bytes of an ed25519 public key in 64 hexadecimal digits, of whoever builds the loader.
const KEY: Option<&str> = option_env!("PRAXI_PUBLIC_KEY");

/// `None`: the loader was built without a key, or with one that is none; it takes no image. There is no key by default: one that
/// everybody has is none.
pub fn owner() -> Option<Owner> {
    let digits: &[u8; 64] = KEY?.as_bytes().try_into().ok()?;
    let mut key = [0; 32];
    for (byte, pair) in key.iter_mut().zip(digits.chunks_exact(2)) {
        *byte = pair.iter().try_fold(0, |byte, &digit| Some(byte << 4 | char::from(digit).to_digit(16)? as u8))?;
    }
    Some(Owner { board: Board::new("stm32h743").ok()?, key })
}
