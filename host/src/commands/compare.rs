//! `praxi compare`: how alike two pictures are.

use super::{Failure, say, say_json};
use crate::measure;
use crate::picture::Picture;
use std::path::PathBuf;

/// Compare two pictures: PSNR and SSIM of linear luminance after a Gaussian of 1 pixel, where both are known
#[derive(clap::Args)]
#[command(after_help = "Example: praxi compare eye.png truth.png")]
pub(super) struct Args {
    /// A PNG: 8 bits a channel are sRGB, 16 bits linear; transparent pixels are left out
    a: PathBuf,
    /// Another of the same size
    b: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let load = |path: &PathBuf| Picture::load(path).map_err(|error| Failure(format!("{}: {error}", path.display())));
    let likeness = measure::compare(&load(&args.a)?, &load(&args.b)?)
        .map_err(|error| Failure(format!("{} and {}: {error}", args.a.display(), args.b.display())))?;
    if args.json {
        say_json(&serde_json::to_value(likeness).expect("three numbers"));
    } else {
        let share = likeness.share * 100.0;
        say(format!("PSNR {:.2} dB, SSIM {:.4}, over {share:.1} % of the pixels", likeness.psnr_db, likeness.ssim));
    }
    Ok(())
}
