//! A report as text, 80 columns wide.

use super::who::Who;
use super::{Report, Row};
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
        "{}: {width} × {height} pixels, {:.1} turns a second, edges within {} px\n{} rounds, seed {}\n",
        report.rig, report.rig_turns_per_second, report.budget_px, report.rounds, report.seed
    );
    match report.baseline {
        Some(Who::Clear) => out += "x: times faster than the clear renderer, since no GPU took part",
        Some(who) => out += &format!("x: times faster than {who}, a pass for each slice"),
        None => return out,
    }
    out += "\nx cores: the same by the time of all cores, which other programs disturb less\n";
    out
}

/// Digits that mean something, in seven columns.
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
        " {:<12} {:<6} {:>7} {:>10} {:>8} {:>8} {:>7} {:>6} {:>7}",
        "renderer", "model", "ms", "quartiles", "cores ms", "slices/s", "turns/s", "x", "x cores"
    );
    for row in rows {
        let sampled = if row.slices_rendered < row.slices { "*" } else { " " };
        let model = projection(row.plan.projection);
        let times = row.turn_ms;
        let percent = |value: f64| 100.0 * (value / times.median - 1.0);
        let _ = writeln!(
            out,
            "{sampled}{:<12} {model:<6} {:>7} {:>10} {:>8} {:>8.0} {:>7} {:>6} {:>7}",
            row.who.to_string(),
            short(times.median),
            format!("{:+.0} {:+.0} %", percent(times.lower), percent(times.upper)),
            row.cores_ms.map_or("-".into(), short),
            row.slices_per_second,
            short(row.turns_per_second),
            row.times_faster.map_or("-".into(), short),
            row.times_less_cores.map_or("-".into(), short),
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
        Projection::ConeTable => "table",
        Projection::ConeRoot => "root",
    }
}

/// Where the time goes, of the rows that say it.
fn stages(rows: &[&Row]) -> String {
    let of_row = |row: &&&Row| {
        let cores = if row.who.is_gpu() { "" } else { " of all threads" };
        let parts: Vec<String> = row.stages.iter().map(|(name, ms)| format!("{name} {}", short(*ms))).collect();
        wrapped(&format!(" {} {}, ms{cores}:", row.who, projection(row.plan.projection)), &parts) + "\n"
    };
    rows.iter().filter(|row| !row.stages.is_empty()).map(|row| of_row(&row)).collect()
}

/// The sweep over slice counts, one line a renderer; the last column is the time of the most slices over that of a quarter of them.
fn sweep(report: &Report, scene: &str) -> String {
    let mut out = String::new();
    for who in Who::ALL {
        let rows = report.sweep(scene, who);
        let Some(last) = rows.last() else { continue };
        if out.is_empty() {
            let counts: String = rows.iter().map(|row| format!(" {:>8}", row.slices)).collect();
            let _ = writeln!(out, " {:<12}{counts}   4 x", "ms by slices");
        }
        let times: String = rows.iter().map(|row| format!(" {:>8}", short(row.turn_ms.median))).collect();
        let quarter = rows.iter().find(|row| row.slices * 4 == last.slices);
        let ratio = quarter.map_or(f64::NAN, |row| last.turn_ms.median / row.turn_ms.median);
        let _ = writeln!(out, " {:<12}{times} {ratio:>5.2}", who.to_string());
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
        if line.trim_start_matches('\n').chars().count() + part.chars().count() > 80 {
            out += &line;
            line = "\n ".into();
        }
        line += &part;
    }
    out + &line
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::Spread;
    use crate::machine::Machine;
    use crate::render::plan::Plan;
    use crate::render::plan::cost::Work;

    fn row(who: Who, ms: f64, slices: u32) -> Row {
        Row {
            scene: "knot-70k".into(),
            triangles: 71_040,
            work: Work::default(),
            slices,
            plan: Plan { halftone: Halftone::AlternatingBlueNoise, ..Plan::default() },
            who,
            renderer: String::new(),
            is_of_sweep: slices != 288,
            runs: 3,
            slices_rendered: if who == Who::Clear { slices / 12 } else { slices },
            prepare_ms: 1.0,
            turn_ms: Spread::of(vec![ms, 1.3 * ms]),
            cores_ms: Some(2.0 * ms),
            slices_per_second: 0.0,
            turns_per_second: 1e3 / ms,
            times_faster: None,
            times_less_cores: None,
            stages: ["transform", "cull", "raster", "resolve"].map(|name| (name, ms)).to_vec(),
            peak_bytes: Some(123_456_789),
        }
    }

    #[test]
    fn a_report_is_eighty_columns_wide_and_compares_like_with_like() {
        let mut rows: Vec<Row> = Who::ALL.into_iter().map(|who| row(who, 23_456.7, 288)).collect();
        rows[4].turn_ms = Spread::of(vec![46_913.4 * 1.15]);
        rows.extend([48, 1152].map(|slices| row(Who::CpuAvx512, f64::from(slices) * 100.0, slices)));
        let mut report = Report {
            program: "praxi",
            version: "0",
            machine: Machine::here(),
            adapters: vec!["llvmpipe".into()],
            rig: "reference".into(),
            image_px: [768; 2],
            rig_turns_per_second: 20.0,
            budget_px: 0.5,
            seed: 1,
            rounds: 3,
            baseline: None,
            rows,
            pack_ms: [(288, Spread::of(vec![9.1]))].into(),
            notes: Vec::new(),
        };
        report.compare();
        assert_eq!(report.baseline, Some(Who::GpuSlice));
        assert!(report.rows[3].times_faster.is_some_and(|times| (times - 2.0).abs() < 1e-9));
        assert_eq!(report.rows[8].times_faster, None, "there is no baseline of as many slices");
        let text = text(&report);
        let long: Vec<&str> = text.lines().skip(1).filter(|line| line.chars().count() > 80).collect();
        assert!(long.is_empty(), "{long:#?}");
        for part in
            ["cpu-avx512", "quartiles", "raster", "* from 24 of 288 slices", "peak memory", "MB: clear 123", "4.91"]
        {
            assert!(text.contains(part), "{part}: {text}");
        }
        report.rows.retain(|row| row.who != Who::GpuSlice);
        report.compare();
        assert_eq!(report.baseline, Some(Who::Clear));
    }
}
