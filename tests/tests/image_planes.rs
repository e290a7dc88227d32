//! The planes that an emulated image's expanding is measured by (`hil-sim/tests/image/planes.rs`) are such as the display shows of the bunny.
//! `WRITE_PLANES=1` writes them anew.

use host::halftoned::Halftoned;
use host::render::plan::{Halftone, Plan};
use host::render::turn::Turn;
use host::stream::TurnPlanes;
use protocol::codec::{ByteStatistics, Codebook, Compressor, Expander, ImageSize, Mask, plane_check};
use protocol::message::Knowledge;
use std::path::Path;
use tests::{bunny, rig, turn};

/// Whatever a device has to know first.
fn knowledge(turn: &Halftoned<&Turn>, size: ImageSize) -> (Knowledge, Vec<u8>) {
    if !turn.mask_ranks().is_empty() {
        return (Knowledge::Mask, turn.mask_ranks().iter().flat_map(|rank| rank.to_le_bytes()).collect());
    }
    let mut statistics = ByteStatistics::default();
    for slice in (0..turn.slices()).step_by(9) {
        statistics.add(turn.plane_bytes(slice), size.row_bytes());
    }
    (Knowledge::Codes, statistics.lengths().to_vec())
}

/// The plane of a turn that is as long as the mean of its compressed planes, or nearly so: as `planes.rs` there reads it.
fn mean(turn: &Halftoned<&Turn>, size: ImageSize, (kind, known): &(Knowledge, Vec<u8>)) -> Vec<u8> {
    let mut compressor = Compressor::new(size);
    match kind {
        Knowledge::Mask => {
            let mut mask = Mask::NONE;
            mask.set(turn.mask_ranks().iter().copied()).unwrap();
            compressor.set_mask(mask);
        }
        Knowledge::Codes => compressor.set_codes(known).unwrap(),
    }
    let planes: Vec<(u64, Vec<u8>)> = (0..turn.slices())
        .map(|slice| {
            let mut compressed = Vec::new();
            compressor.compress(turn.plane_bytes(slice), turn.hint(slice), &mut compressed);
            (plane_check(turn.plane_bytes(slice)), compressed)
        })
        .collect();
    let mean = planes.iter().map(|(_, plane)| plane.len()).sum::<usize>() / planes.len();
    let (check, plane) = planes.iter().min_by_key(|(_, plane)| plane.len().abs_diff(mean)).unwrap();
    [&(known.len() as u32).to_le_bytes()[..], known, &check.to_le_bytes(), plane].concat()
}

/// The plane that is in a file.
fn expanded(kind: Knowledge, file: &[u8], size: ImageSize) -> Vec<u8> {
    let (count, rest) = file.split_first_chunk().unwrap();
    let (known, rest) = rest.split_at(u32::from_le_bytes(*count) as usize);
    let (check, compressed) = rest.split_first_chunk().unwrap();
    let mut book = Box::new(Codebook::EMPTY);
    book.learn(kind, [0, known.len()], known).unwrap();
    let (mut plane, mut expander) = (vec![0; size.plane_bytes()], Expander::new(size));
    expander.push(compressed, &book, &mut plane).unwrap();
    expander.finish(&book, &mut plane, u64::from_le_bytes(*check)).unwrap();
    plane
}

#[test]
fn the_frozen_planes_are_the_bunnys() {
    let (Some(scene), rig) = (bunny(), rig("reference")) else { return };
    for halftone in [Halftone::BlueNoise, Halftone::OptimisedDiffusion] {
        let rendered = turn(&scene, &rig, &Plan { halftone, ..Plan::default() });
        let size = ImageSize::new(rendered.width(), rendered.height()).unwrap();
        let halftoned = Halftoned { turn: &rendered, halftone, number: 0 };
        let known = knowledge(&halftoned, size);
        let file =
            Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../hil-sim/tests/image/planes/bunny-{halftone}.bin"));
        let now = mean(&halftoned, size, &known);
        if std::env::var_os("WRITE_PLANES").is_some() {
            std::fs::write(&file, &now).unwrap();
        }
        let frozen = std::fs::read(&file).unwrap();
        println!("{halftone}: {} bytes then, {} now", frozen.len(), now.len());
        assert!(frozen.len().abs_diff(now.len()) < now.len() / 20, "{halftone}: another turn than it was");
        let lit = |file: &[u8]| expanded(known.0, file, size).iter().map(|byte| byte.count_ones()).sum::<u32>();
        assert!(
            lit(&frozen).abs_diff(lit(&now)) < lit(&now) / 5,
            "{halftone}: {} pixels for {}",
            lit(&frozen),
            lit(&now)
        );
    }
}
