//! `praxi image`: keys and signed firmware images.

use super::{Failure, say, say_json};
use crate::flash::{FlashError, IMAGE_BYTES_MAX, public, read_key, sign, to_hex};
use crate::{input, output};
use protocol::image::{Board, ImageError, MAGIC, Version};
use serde_json::json;
use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Make a key, or a signed firmware image
#[derive(clap::Args)]
pub(super) struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    /// Make a secret key, and its public half beside it in FILE.pub, which a boot loader is compiled with
    #[command(after_help = "Example: praxi image key owner.key")]
    Key {
        /// The file to write; none may be there
        file: PathBuf,
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// Make an image of a firmware's bytes, as they lie in flash behind the header of 1024 bytes
    #[command(
        after_help = "Example: praxi image sign firmware.bin --key owner.key --board sim --version 1.2.3 --out firmware.img"
    )]
    Sign {
        /// The firmware, as objcopy -O binary writes it
        code: PathBuf,
        /// The owner's secret key
        #[arg(long, value_name = "FILE")]
        key: PathBuf,
        /// The board that it runs on
        #[arg(long, value_parser = |name: &str| Board::new(name))]
        board: Board,
        /// Its version; a device takes newer ones
        #[arg(long, allow_hyphen_values = true, value_parser = |text: &str| text.parse::<Version>())]
        version: Version,
        /// The image to write; an earlier one is replaced
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    match &args.what {
        What::Key { file, json } => make_key(file, *json),
        What::Sign { code, key, board, version, out, json } => {
            if key.extension().is_some_and(|extension| extension == "pub") {
                return Err(Failure(format!("{}: that is a public key: a secret one signs", key.display())));
            }
            let key = read_key(key)?;
            let bytes = input::read(code, IMAGE_BYTES_MAX).map_err(|error| FlashError::File(code.clone(), error))?;
            if bytes.is_empty() {
                return Err(Failure(format!("{}: empty: allowed is code of one byte or more", code.display())));
            }
            let failed = |error: ImageError| FlashError::Image(code.clone(), error);
            let image = sign(&key, *board, *version, bytes).map_err(failed)?;
            if out.exists() && !input::begins_with(out, &MAGIC).unwrap_or(false) {
                return Err(Failure(format!("{} is there and no firmware image: name another", out.display())));
            }
            output::File::begin_over(out)?.finish(&image)?;
            if *json {
                let (version, board) = (version.to_string(), board.name());
                say_json(&json!({ "image": out, "bytes": image.len(), "version": version, "board": board }));
            } else {
                say(format!("{}: {} bytes, version {version} for {board}", out.display(), image.len()));
            }
            Ok(())
        }
    }
}

fn make_key(file: &Path, as_json: bool) -> Result<(), Failure> {
    let mut secret = [0; 32];
    getrandom::fill(&mut secret).map_err(|error| Failure(format!("no random bytes: {error}")))?;
    let mut name = file.as_os_str().to_owned();
    name.push(".pub");
    let open = Path::new(&name);
    write_new(open, &to_hex(&public(&secret)), 0o644)?;
    write_new(file, &to_hex(&secret), 0o600)?;
    if as_json {
        say_json(&json!({ "secret": file, "public": open }));
    } else {
        say(format!("{}: keep it secret; {}: compile it into the boot loader", file.display(), open.display()));
    }
    Ok(())
}

fn write_new(file: &Path, text: &str, mode: u32) -> Result<(), Failure> {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, mode);
    #[cfg(not(unix))]
    let _ = mode;
    let written = options.open(file).and_then(|mut file| writeln!(file, "{text}"));
    written.map_err(|error| Failure(format!("cannot write {}: {error}; allowed is a new name", file.display())))
}
