//! Turns as they are rendered, seen and compared; scenes and damaged turns.

use crate::TRIANGLE;
use crate::desk::Desk;
use serde_json::Value;
use std::fs;

#[test]
fn a_turn_is_rendered_seen_and_compared() {
    let desk = Desk::new();
    let rendered = desk.json("render builtin --rig small.toml --out turn");
    assert_eq!((&rendered["slices"], &rendered["pictures"]), (&48.into(), &2.into()));
    let names: Vec<_> = fs::read_dir(desk.path("turn")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names.len(), 3, "{names:?}");
    let note: Value = serde_json::from_slice(&fs::read(desk.path("turn/rotation.json")).unwrap()).unwrap();
    assert_eq!(note["method"]["precision"], "single");
    assert_eq!(note["method"]["halftone"], "optimised-diffusion");
    assert!(rendered["error_px"].as_f64().unwrap() <= 0.5, "{rendered}");
    assert_eq!(note["method"]["shading"], "lambert");
    assert_eq!(note["rig"]["projector"]["width_px"], 96);

    desk.json("see turn --from -0.2,0.35,0.85 --pixels 64 --out eye.png");
    desk.json("truth builtin --from -0.2,0.35,0.85 --pixels 64 --out truth.png");
    let likeness = desk.json("compare eye.png truth.png");
    assert!(likeness["psnr_db"].as_f64().unwrap() > 18.0, "{likeness}");

    desk.json("see turn --from 0,0.35,0.9 --pixels 64 --eyes 0.064 --linear --physical --out eye.png");
    let different = desk.json("compare eye-left.png eye-right.png");
    assert!(different["psnr_db"].as_f64().unwrap() < 40.0, "{different}");
    assert_eq!(image::open(desk.path("eye-left.png")).unwrap().color(), image::ColorType::La16);
}

#[test]
fn grey_slices_are_pictures_of_luminance() {
    let desk = Desk::new();
    desk.json("render builtin --rig small.toml --halftone grey --projection planar --fit-m 0.1 --out turn");
    let slice = image::open(desk.path("turn/slice_000.png")).unwrap();
    assert_eq!((slice.width(), slice.color()), (96, image::ColorType::L8));
    assert_eq!(fs::read_dir(desk.path("turn")).unwrap().count(), 49);
    desk.json("see turn --from 0,0.35,0.9 --pixels 32 --out eye.png");
}

#[test]
fn bad_scenes_are_refused() {
    let desk = Desk::new();
    desk.write("empty.obj", "v 0 0 0\n");
    desk.write("nan.obj", TRIANGLE.replace("0.03", "nan"));
    desk.write("index.obj", TRIANGLE.replace("f 1 2 3", "f 1 2 9"));
    desk.write("flat.obj", "v 0 0 0\nv 0.03 0 0\nv 0.06 0 0\nf 1 2 3\n");
    desk.write("noise.glb", [7u8; 300]);
    desk.write("noise.ply", "ply\nformat ascii 1.0\nelement vertex 4000000000\n");
    desk.write("scene.txt", "x");
    for (scene, words) in [
        ("none.obj", vec!["none.obj", "No such file"]),
        ("empty.obj", vec!["empty.obj", "triangle"]),
        ("nan.obj", vec!["nan.obj", "line 2", "finite"]),
        ("index.obj", vec!["index.obj", "line 4", "9"]),
        ("flat.obj", vec!["flat.obj", "triangle"]),
        ("noise.glb", vec!["noise.glb"]),
        ("noise.ply", vec!["noise.ply"]),
        ("scene.txt", vec!["scene.txt", ".glb", ".obj", ".ply"]),
        (".", vec!["."]),
    ] {
        desk.refuses(&format!("render {scene} --rig small.toml --out turn"), &words);
        desk.refuses(&format!("truth {scene} --from 0,0.35,0.9 --out truth.png"), &words);
    }
}

#[test]
fn odd_scenes_are_drawn_with_a_warning() {
    let desk = Desk::new();
    desk.write("some.obj", format!("{TRIANGLE}v 0 0 0\nf 1 1 2\nf 1 4 2\n"));
    assert!(desk.warnings("render some.obj --rig small.toml --out turn").contains("degenerate"));
    desk.write("mark.obj", format!("\u{feff}{TRIANGLE}"));
    assert!(desk.warnings("render mark.obj --rig small.toml --out turn").is_empty());
    assert!(desk.warnings("render some.obj --fit-m 0.0001 --rig small.toml --out turn").contains("--fit-m"));
    desk.write("large.obj", TRIANGLE.replace("0.03", "3"));
    let text = desk.warnings("render large.obj --rig small.toml --out turn");
    let fit = text.split("--fit-m ").nth(1).and_then(|rest| rest.split(' ').next()).expect(&text);
    assert!(desk.warnings(&format!("render large.obj --rig small.toml --fit-m {fit} --out turn")).is_empty());
    let larger = fit.parse::<f64>().unwrap() + 0.005;
    assert!(!desk.warnings(&format!("render large.obj --rig small.toml --fit-m {larger} --out turn")).is_empty());
}

#[test]
fn a_damaged_turn_is_refused() {
    let desk = Desk::new();
    desk.json("render builtin --rig small.toml --out turn");
    let see = "see turn --from 0,0.35,0.9 --pixels 16 --out eye.png";
    let frame = fs::read(desk.path("turn/frame_01.png")).unwrap();
    let note = fs::read_to_string(desk.path("turn/rotation.json")).unwrap();
    for length in [0, 8, frame.len() / 2, frame.len() - 20] {
        desk.write("turn/frame_01.png", &frame[..length]);
        desk.refuses(see, &["turn/frame_01.png"]);
    }
    fs::remove_file(desk.path("turn/frame_01.png")).unwrap();
    desk.refuses(see, &["turn/frame_01.png", "No such file"]);
    image::RgbImage::new(95, 96).save(desk.path("turn/frame_01.png")).unwrap();
    desk.refuses(see, &["turn/frame_01.png", "96 × 96"]);
    desk.write("turn/frame_01.png", &frame);
    for broken in [&note[..note.len() / 2], "{}", &note.replace("\"slices\": 48", "\"slices\": 72")] {
        desk.write("turn/rotation.json", broken);
        desk.refuses(see, &["turn/rotation.json"]);
    }
    desk.write("turn/rotation.json", note.replace("\"tilt_deg\": 45.0", "\"tilt_deg\": 145.0"));
    desk.refuses(see, &["turn/rotation.json", "tilt_deg"]);
    fs::remove_file(desk.path("turn/rotation.json")).unwrap();
    desk.refuses(see, &["turn/rotation.json"]);
}

#[test]
fn pictures_that_cannot_be_compared_are_refused() {
    let desk = Desk::new();
    image::RgbImage::new(4, 4).save(desk.path("a.png")).unwrap();
    image::RgbImage::new(4, 5).save(desk.path("b.png")).unwrap();
    desk.write("c.png", "x");
    desk.refuses("compare a.png b.png", &["4 × 4", "4 × 5"]);
    desk.refuses("compare a.png c.png", &["c.png"]);
    desk.refuses("compare a.png d.png", &["d.png"]);
}
