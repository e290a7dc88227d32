//! The house rules that a compiler does not hold: who may use whom, what stands at the top, what README's map names.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize().unwrap()
}

/// Folders of packages, which have the last part's name.
const ROOMS: [&str; 8] = ["protocol", "shaders", "firmware", "hil-sim", "host/raster", "host/bulk", "host", "tests"];
/// Those with unsafe code: instructions of a processor, and libusb's transfers.
const UNSAFE: [&str; 2] = ["host/raster/src", "host/bulk/src/transfer.rs"];

/// Names of the packages that `room` depends on, in any way but for its own tests.
fn dependencies(room: &str) -> BTreeSet<String> {
    let text = fs::read_to_string(root().join(room).join("Cargo.toml")).unwrap();
    let manifest: toml::Table = text.parse().unwrap();
    let tables = ["dependencies", "build-dependencies"].into_iter().filter_map(|name| manifest.get(name)?.as_table());
    tables.flat_map(|table| table.keys().cloned()).collect()
}

fn sources(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let (folders, files): (Vec<_>, Vec<_>) = entries.partition(|path| path.is_dir());
    let below = folders.iter().filter(|folder| !folder.ends_with("target")).flat_map(|folder| sources(folder));
    below.chain(files.into_iter().filter(|file| file.extension().is_some_and(|extension| extension == "rs"))).collect()
}

#[test]
fn rooms_use_only_those_below_them() {
    let packages = ROOMS.map(|room| room.rsplit('/').next().unwrap());
    let allowed = |room: &str| match room {
        "protocol" => vec![],
        "shaders" | "firmware" => vec!["protocol"],
        "hil-sim" => vec!["protocol", "firmware"],
        "host/raster" => vec!["shaders"],
        "host/bulk" => vec![],
        "host" => vec!["protocol", "shaders", "hil-sim", "raster", "bulk"],
        _ => packages.to_vec(),
    };
    for room in ROOMS {
        for other in packages {
            if dependencies(room).contains(other) {
                assert!(allowed(room).contains(&other), "{room} must not use {other}");
            }
        }
    }
}

#[test]
fn wgpu_stays_in_the_host_and_hals_with_the_boards() {
    for room in ROOMS {
        for name in dependencies(room) {
            let is_hal = name.contains("-hal") || name.starts_with("embassy-stm32") || name.starts_with("cortex-m");
            assert!(!is_hal, "{room} uses {name}: a HAL belongs below firmware/boards");
            assert!(!name.starts_with("wgpu") || room == "host", "{room} uses {name}");
        }
    }
}

#[test]
fn the_simulator_enters_the_host_by_its_doors() {
    let host = root().join("host/src");
    for file in sources(&host) {
        let place = file.strip_prefix(&host).unwrap().to_string_lossy().into_owned();
        let is_door = place == "link/sim.rs" || place == "seen.rs" || place.starts_with("commands/");
        let text = fs::read_to_string(&file).unwrap();
        let product = text.split("#[cfg(test)]\nmod tests").next().unwrap();
        let is_test = place.contains("tests");
        assert!(is_door || is_test || !product.contains("hil_sim"), "host/src/{place} uses hil-sim");
    }
}

#[test]
fn unsafe_code_has_its_places_and_reasons() {
    let places = UNSAFE.map(|place| root().join(place));
    for file in ROOMS.iter().flat_map(|room| sources(&root().join(room))) {
        let text = fs::read_to_string(&file).unwrap();
        let words = ["allow(unsafe", "_code)"].concat();
        let is_place = places.iter().any(|place| file.starts_with(place));
        assert!(!text.contains(&words) || is_place, "{}: unsafe code has its places", file.display());
        let lines: Vec<_> = text.lines().collect();
        for (number, line) in
            lines.iter().enumerate().filter(|(_, line)| line.contains(["unsafe", " {"].concat().as_str()))
        {
            // A type's reason, in its documentation, is that of its methods.
            let above = &lines[..number];
            let is_explained = above.iter().any(|line| line.contains("SAFETY"));
            assert!(is_explained, "{}:{}: {line}: why is it sound?", file.display(), number + 1);
        }
    }
}

#[test]
fn the_top_level_is_the_fixed_one() {
    let fixed = [
        "Cargo.toml",
        "Cargo.lock",
        "firmware",
        "host",
        "protocol",
        "shaders",
        "hil-sim",
        "tests",
        "README.md",
        "CHANGELOG.md",
        "LICENSE-MIT",
        "LICENSE-APACHE",
        "rust-toolchain.toml",
        "target",
        "praxi-demo",
    ];
    for entry in fs::read_dir(root()).unwrap() {
        let name = entry.unwrap().file_name().to_string_lossy().into_owned();
        assert!(name.starts_with('.') || fixed.contains(&name.as_str()), "{name} does not belong at the top");
    }
}

#[test]
fn the_readme_names_what_is_there() {
    let text = fs::read_to_string(root().join("README.md")).unwrap();
    let map = text.split("## Where things are").nth(1).expect("README has a code map").split("\n## ").next().unwrap();
    let mut count = 0;
    for path in map.lines().filter(|line| line.starts_with("| `")).filter_map(|line| line.split('`').nth(1)) {
        assert!(root().join(path).exists(), "README's code map names {path}");
        count += 1;
    }
    assert!(count > 10);
    for link in text.split("](").skip(1).filter_map(|rest| rest.split([')', '#']).next()) {
        assert!(root().join(link).exists(), "README links to {link}");
    }
}
