//! `praxi plan`, and what a terminal shows of its work.

use crate::desk::Desk;
use std::process::Command;

#[test]
fn a_plan_is_explained_and_impossible_ones_are_refused() {
    let desk = Desk::new();
    let plan = desk.json("plan builtin --rig small.toml --budget-px 0.5");
    assert!(plan["chosen"]["error_px"].as_f64().unwrap() <= 0.5, "{plan}");
    assert!(plan["weighed"].as_array().unwrap().len() > 5 && plan["ms_per_cost"].as_f64().unwrap() > 0.0, "{plan}");
    let fixed =
        desk.json("plan builtin --rig small.toml --projection planar --precision double --edges uniform --budget-px 9");
    assert_eq!(
        (&fixed["chosen"]["plan"]["edges"], &fixed["chosen"]["plan"]["precision"]),
        (&"uniform".into(), &"double".into())
    );
    let plan = "plan builtin --rig small.toml";
    desk.refuses(&format!("{plan} --budget-px 1e-12"), &["--budget-px", "most accurate", "px"]);
    desk.refuses(&format!("{plan} --budget-ms 0.001"), &["--budget-ms 0.001", "fastest", "ms"]);
    desk.refuses(&format!("{plan} --budget-px 0"), &["--budget-px", "above 0"]);
    desk.refuses(&format!("{plan} --budget-ms -3"), &["--budget-ms", "above 0"]);
    desk.refuses(&format!("{plan} --budget-px NaN"), &["--budget-px", "above 0"]);
    desk.refuses(&format!("{plan} --budget-px 1 --budget-ms 1"), &["--budget-px", "--budget-ms"]);
    desk.refuses(&format!("{plan} --projection cylinder"), &["--projection", "planar", "cone-newton"]);
    desk.write("far.obj", "v 100 0 0\nv 100 1 0\nv 100 0 1\nf 1 2 3\n");
    desk.refuses("plan far.obj --rig small.toml", &["nothing", "visible", "--fit-m"]);
    desk.refuses("render far.obj --rig small.toml --out turn", &["nothing", "visible"]);
}

/// On a terminal, which `script` plays; nothing of it stays.
#[test]
#[cfg(target_os = "linux")]
fn waiting_is_shown_on_a_terminal_alone() {
    let desk = Desk::new();
    let plan = "plan knot-5k --rig small.toml";
    assert!(desk.run(plan).stderr.is_empty());
    let line = format!("{} {plan}", env!("CARGO_BIN_EXE_praxi"));
    let Ok(shown) = Command::new("script").args(["-qec", &line, "/dev/null"]).current_dir(&desk.folder).output() else {
        return println!("skipped: there is no script to play a terminal");
    };
    let shown = String::from_utf8(shown.stdout).unwrap();
    assert!(shown.contains("choosing methods") && shown.contains("weighing other methods"), "{shown:?}");
}
