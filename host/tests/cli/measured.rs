//! `praxi chart`, `praxi bench` and `praxi wire-chart`.

use crate::desk::Desk;
use std::fs;

#[test]
fn a_chart_is_written_whole() {
    let desk = Desk::new();
    let chart = desk.json("chart boxes --rig small.toml --quick --out chart");
    assert!(chart["optics"].as_array().unwrap().len() > 10 && chart["halftones"].as_array().unwrap().len() > 10);
    let csv = fs::read_to_string(desk.path("chart/chart.csv")).unwrap();
    let columns = csv.lines().next().unwrap().split(',').count();
    assert!(csv.lines().count() > 20 && csv.lines().all(|line| line.split(',').count() == columns));
    let summary = fs::read_to_string(desk.path("chart/summary.md")).unwrap();
    assert!(["## What to use when", "## Where methods fail", "on the front"].iter().all(|part| summary.contains(part)));
    assert!(fs::read_to_string(desk.path("chart/chart.svg")).unwrap().contains("<svg"));
    assert!(image::open(desk.path("chart/chart.png")).unwrap().width() > 1000);
    desk.refuses("chart nosuch.obj --rig small.toml --quick --out chart", &["nosuch.obj"]);
    desk.refuses("chart boxes --rig nosuch --quick --out chart", &["nosuch"]);
}

#[test]
fn renderers_are_timed_and_bad_wishes_refused() {
    let desk = Desk::new();
    let bench = "bench --scene boxes --rig small.toml";
    let slow_and_fast = format!("{bench} --renderer clear --renderer cpu-portable");
    let report = desk.json(&format!("{slow_and_fast} --rounds 2 --halftone blue-noise --slices-sweep --out bench"));
    let rows = report["rows"].as_array().unwrap();
    // Two renderers, two models; and the quick one by the first model with five other slice counts, without a baseline.
    assert_eq!(rows.len(), 4 + 5, "{report}");
    assert!(rows.iter().all(|row| row["turn_ms"]["median"].as_f64().unwrap() > 0.0));
    assert!(rows[..2].iter().all(|row| row["times_faster"].is_f64() && row["work"]["triangles"].is_f64()));
    assert!(rows[0]["slices_rendered"] == 48 && rows[1]["slices_rendered"] == 48 && rows[0]["slices"] == 48);
    #[cfg(target_os = "linux")]
    assert!(rows[0]["peak_bytes"].as_f64().unwrap() > 1e6 && rows[0]["cores_ms"].is_f64());
    assert_eq!((&report["baseline"], &report["rounds"]), (&"clear".into(), &2.into()));
    let text = fs::read_to_string(desk.path("bench/bench.txt")).unwrap();
    assert!(text.contains("cpu-portable") && text.contains("packing 48 slices"), "{text}");
    assert!(fs::read_to_string(desk.path("bench/bench.svg")).unwrap().contains("<svg"));
    assert!(image::open(desk.path("bench/bench.png")).unwrap().width() > 1000);
    let quick = desk.json(&format!("{slow_and_fast} --quick --out bench"));
    assert_eq!(quick["rows"].as_array().unwrap().len(), 2);

    desk.refuses("bench --scene nosuch.obj --quick", &["nosuch.obj", "No such file"]);
    desk.refuses("bench --scene knot --quick", &["knot", ".obj"]);
    desk.refuses(&format!("{bench} --scene boxes"), &["boxes", "own name"]);
    desk.refuses(&format!("{bench} --rounds 0"), &["--rounds", "1..=500"]);
    desk.refuses(&format!("{bench} --seconds 0"), &["--seconds", "0.1"]);
    desk.refuses(&format!("{bench} --rounds 3 --seconds 3"), &["--rounds", "--seconds"]);
    desk.refuses(&format!("{bench} --budget-px 1e-12"), &["most accurate"]);
    desk.refuses(&format!("{bench} --renderer fast"), &["--renderer", "cpu-portable", "gpu-slice"]);
    desk.refuses(&format!("{bench} --adapter nosuch"), &["gpu-slice", "no GPU adapter", "nosuch"]);
    desk.refuses(&format!("{bench} --renderer gpu-compute --adapter nosuch"), &["gpu-compute", "nosuch"]);
    desk.refuses(&format!("{bench} --renderer clear --adapter nosuch"), &["--adapter nosuch", "--renderer"]);
    desk.refuses(&format!("{bench} --halftone joint"), &["joint", "blue-noise"]);
}

#[test]
fn planes_of_a_mask_are_small_enough_for_usb() {
    let desk = Desk::new();
    let arguments = "--halftone blue-noise --halftone floyd-steinberg --degrees 7 --out wire";
    let chart = desk.json(&format!("wire-chart builtin --rig reference {arguments}"));
    let points = chart["points"].as_array().unwrap();
    assert_eq!(points.len(), 2 * 5, "{chart}");
    let ratio = |halftone: &str, coding: &str| {
        let is_it = |point: &&serde_json::Value| point["halftone"] == halftone && point["coding"] == coding;
        points.iter().find(is_it).unwrap()["ratio"].as_f64().unwrap()
    };
    // 20 turns a second of 21.2 MB over 40 MB/s.
    assert!(ratio("blue-noise", "wire") > 10.6, "{chart}");
    for halftone in ["blue-noise", "floyd-steinberg"] {
        for other in ["runs", "lz4", "zstd", "xor-zstd"] {
            assert!(ratio(halftone, "wire") > 1.2 * ratio(halftone, other), "{halftone}, {other}: {chart}");
        }
    }
    assert!(fs::read_to_string(desk.path("wire/summary.md")).unwrap().lines().all(|line| line.chars().count() <= 80));
    assert!(image::open(desk.path("wire/wire-chart.png")).unwrap().width() > 1000);
    desk.refuses("wire-chart builtin --halftone grey --out wire", &["--halftone grey", "blue-noise"]);
    desk.refuses("wire-chart builtin --degrees nan --out wire", &["--degrees", "finite"]);
    desk.refuses("wire-chart nosuch.obj --out wire", &["nosuch.obj"]);
    desk.refuses("wire-chart builtin --clip Walk --out wire", &["--clip Walk", "no scene has a clip"]);
}
