//! A report as text, 80 columns wide.

use super::who::Who;
use super::{Report, Row, SWEEP};
use crate::render::plan::{Halftone, Projection};
use core::fmt::Write;

/// The whole report.
pub fn text(report: &Report) -> String {
    let mut out = heading(report);
    for scene in report.scenes() {
        let rows: Vec<&Row> = report.rows.iter().filter(|row| row.scene == scene && !row.is_of_sweep).collect();
        let mut halftones: Vec<Halftone> = rows.iter().map(|row| row.plan.halftone).collect();
        halftones.dedup();
        halftones.sort_by_key(|halftone| halftone.to_string());
        halftones.dedup();
        for halftone in halftones {
            let of_halftone: Vec<&Row> = rows.iter().copied().filter(|row| row.plan.halftone == halftone).collect();
            out += &times(scene, halftone, &of_halftone);
        }
        out += &stages(&rows);
        out += &sweep(report, scene);
    }
    out += &packs(report);
    out += &memory(report);
    for note in &report.notes {
        out += &format!("\nnote: {note}");
    }
    out
}

fn heading(report: &Report) -> String {
    let machine = &report.machine;
    let mut out = format!("{}, {} cores, {} threads\n", machine.processor, machine.cores, machine.threads);
    for adapter in &report.adapters {
        out += &format!("GPU {adapter}\n");
    }
    let [width, height] = report.image_px;
    out += &format!(
        "{}: {width} × {height} pixels, {:.1} turns a second; edges within {} px; {} rounds, seed {}\n",
        report.rig, report.rig_turns_per_second, report.budget_px, report.rounds, report.seed
    );
    match report.baseline {
        Some(Who::Clear) => out += "x: times faster than the clear renderer, since no GPU took part\n",
        Some(who) => out += &format!("x: times faster than {who}, a pass for each slice\n"),
        None => {}
    }
    out
}

/// Digits that mean something in seven columns.
fn short(value: f64) -> String {
    match value {
        small if small < 10.0 => format!("{value:.2}"),
        middle if middle < 1000.0 => format!("{value:.1}"),
        _ => format!("{value:.0}"),
    }
}

fn times(scene: &str, halftone: Halftone, rows: &[&Row]) -> String {
    let Some(first) = rows.first() else { return String::new() };
    let mut out = format!("\n{scene}, {} triangles, {} slices, {halftone}\n", first.triangles, first.slices);
    let _ = writeln!(
        out,
        " {:<12} {:<11} {:>8} {:^17} {:>8} {:>8} {:>6}",
        "renderer", "model", "ms", "quartiles", "cores ms", "turns/s", "x"
    );
    for row in rows {
        let sampled = if row.slices_rendered < row.slices { "*" } else { " " };
        let model = projection(row.plan.projection);
        let times = row.turn_ms;
        let _ = writeln!(
            out,
            "{sampled}{:<12} {model:<11} {:>8} {:>8}-{:<8} {:>8} {:>8} {:>6}",
            row.who.to_string(),
            short(times.median),
            short(times.lower),
            short(times.upper),
            row.cores_ms.map_or("-".into(), short),
            short(row.turns_per_second),
            row.times_faster.map_or("-".into(), short),
        );
    }
    if let Some(row) = rows.iter().find(|row| row.slices_rendered < row.slices) {
        let _ = writeln!(out, "* from {} of {} slices, scaled up", row.slices_rendered, row.slices);
    }
    out
}

fn projection(projection: Projection) -> &'static str {
    match projection {
        Projection::Planar => "planar",
        Projection::ConeNewton => "cone",
        Projection::ConeTable => "cone table",
        Projection::ConeRoot => "cone root",
    }
}

/// Where the time goes, of the rows that say it: one line a row, wrapped.
fn stages(rows: &[&Row]) -> String {
    let mut out = String::new();
    for row in rows.iter().filter(|row| !row.stages.is_empty()) {
        let mut line = format!(" {} {}, ms of all cores:", row.who, projection(row.plan.projection));
        if row.who.is_gpu() {
            line = format!(" {} {}, ms:", row.who, projection(row.plan.projection));
        }
        for (name, ms) in &row.stages {
            let part = format!(" {name} {},", short(*ms));
            if line.chars().count() + part.chars().count() > 80 {
                out += &line;
                out += "\n";
                line = "  ".into();
            }
            line += &part;
        }
        out += line.trim_end_matches(',');
        out += "\n";
    }
    out
}

fn sweep(report: &Report, scene: &str) -> String {
    let mut out = String::new();
    for who in Who::ALL {
        let rows = report.sweep(scene, who);
        let (Some(first), Some(last)) = (rows.first(), rows.last()) else { continue };
        if out.is_empty() {
            let counts: String = rows.iter().map(|row| format!(" {:>7}", row.slices)).collect();
            out = format!(" {:<12} ms by slices:{}\n", scene, counts);
        }
        let times: String = rows.iter().map(|row| format!(" {:>7}", short(row.turn_ms.median))).collect();
        let _ = writeln!(out, " {:<12}              {times}", who.to_string());
        let of = |slices| rows.iter().find(|row| row.slices == slices).map(|row| row.turn_ms.median);
        let _ = (first, last);
        if let (Some(few), Some(many)) = (of(288), of(SWEEP[SWEEP.len() - 1])) {
            let _ = writeln!(out, "   4 x the slices of 288 take {:.2} x the time", many / few);
        }
    }
    out
}

fn packs(report: &Report) -> String {
    let mut out = String::new();
    for (slices, times) in &report.pack_ms {
        let _ = write!(out, "\npacking {slices} slices into frames: {} ms", short(times.median));
        let _ = write!(out, " ({}-{}), on top of each binary turn", short(times.lower), short(times.upper));
    }
    out + "\n"
}

/// Peak memory by scene and renderer, where it was measured.
fn memory(report: &Report) -> String {
    let mut out = String::new();
    for scene in report.scenes() {
        let known = report.rows.iter().filter(|row| row.scene == scene);
        let figures: Vec<String> =
            known.filter_map(|row| Some(format!("{} {:.0}", row.who, row.peak_bytes? as f64 / 1e6))).collect();
        if !figures.is_empty() {
            out += &wrapped(&format!("\npeak memory of a process, {scene}, MB:"), &figures);
        }
    }
    out
}

/// `start` and `parts` with commas, in lines of 80 columns.
fn wrapped(start: &str, parts: &[String]) -> String {
    let (mut out, mut line) = (String::new(), start.to_string());
    for (index, part) in parts.iter().enumerate() {
        let part = format!(" {part}{}", if index + 1 < parts.len() { "," } else { "" });
        if line.trim_start().chars().count() + part.chars().count() > 80 {
            out += &line;
            line = "\n ".into();
        }
        line += &part;
    }
    out + &line
}
