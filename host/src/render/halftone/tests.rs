use super::*;
use crate::render::Renderer;
use crate::render::clear::ClearRenderer;
use crate::render::plan::Plan;
use crate::scene::{Scene, Shading, shade};
use shaders::project::Sight;

const SMALL: [(&str, &str); 3] = [
    ("width_px = 768", "width_px = 160"),
    ("height_px = 768", "height_px = 144"),
    ("principal_px = [384.0, 384.0]", "principal_px = [80.0, 72.0]"),
];

/// The rig of that name with an image of 160 × 144 pixels and `changes`.
fn small(name: &str, changes: &[(&str, &str)]) -> Rig {
    let text = std::fs::read_to_string(format!("{}/rigs/{name}.toml", env!("CARGO_MANIFEST_DIR"))).unwrap();
    let focal = if name == "tent" {
        ("focal_px = 2300.0", "focal_px = 480.0")
    } else {
        ("focal_px = 3072.0", "focal_px = 640.0")
    };
    let text = SMALL.iter().chain([&focal]).chain(changes).fold(text, |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replace(from, to)
    });
    Rig::parse(&text).unwrap()
}

fn grey(rig: &Rig) -> Turn {
    let scene = shade(&Scene::builtin(), Shading::Lambert, false);
    ClearRenderer.render_turn(&scene, rig, &Plan { halftone: Halftone::Grey, ..Plan::default() }, &|| ()).unwrap()
}

#[test]
fn a_carried_turn_does_not_depend_on_threads_nor_on_what_else_is_asked_for() {
    let rig = small("reference", &[]);
    let grey = grey(&rig);
    let by = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| binary_turn(&grey, &rig, Halftone::SightLine, 0, &|| ()))
    };
    let whole = by(1);
    assert!(whole.mean(0) > 0.01 && whole == by(3));
    let some = halftone_slices(&grey, &rig, Halftone::SightLine, 0, &[0, 23, 30, 287], &|| ());
    for slice in 0..288 {
        let expected = if [0, 23, 30, 287].contains(&slice) { whole.mean(slice) } else { 0.0 };
        assert_eq!(some.mean(slice), expected, "{slice}");
        assert!(expected == 0.0 || some.slice(slice) == whole.slice(slice), "{slice}");
    }
    let read = slices_read(&rig, &[0, 30]);
    assert_eq!(read, [0, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30, 283, 284, 285, 286, 287]);
}

#[test]
fn every_method_keeps_means_and_silhouettes_on_any_rig() {
    let clockwise = ("\"counter-clockwise\"", "\"clockwise\"");
    let few = ("slices = 288 ", "slices = 48 ");
    for rig in [small("reference", &[clockwise, few]), small("tent", &[few]), small("high-viewer", &[])] {
        let grey = grey(&rig);
        let mean =
            |turn: &Turn| (0..turn.slices()).map(|slice| turn.mean(slice)).sum::<f64>() / f64::from(turn.slices());
        for method in <Halftone as clap::ValueEnum>::value_variants() {
            for number in 0..method.turns() {
                let turn = binary_turn(&grey, &rig, *method, number, &|| ());
                let (got, wanted) = (mean(&turn), mean(&grey));
                assert!((got - wanted).abs() < 0.02 * wanted, "{} {method:?}: {got} of {wanted}", rig.name);
            }
        }
        let turn = binary_turn(&grey, &rig, Halftone::SightLine, 0, &|| ());
        let lit = |cell: usize| turn.bytes()[cell / 8] >> (cell % 8) & 1 == 1;
        assert!(grey.bytes().iter().enumerate().all(|(cell, value)| *value > 0 || !lit(cell)), "{}", rig.name);
    }
}

#[test]
fn the_renderer_carries_as_the_grey_turn_does() {
    let rig = small("reference", &[]);
    let scene = shade(&Scene::builtin(), Shading::Lambert, false);
    let plan = Plan { halftone: Halftone::SightLine, ..Plan::default() };
    let slices = [2, 3, 50];
    let rendered = ClearRenderer.render_slices(&scene, &rig, &plan, &slices, &|| ()).unwrap();
    let grey = grey(&rig);
    assert!(rendered == halftone_slices(&grey, &rig, Halftone::SightLine, 0, &slices, &|| ()));
}

/// The grid against the sight line of each pixel, and a sight line against itself.
#[test]
fn sight_lines_are_found_again() {
    for name in ["reference", "tent"] {
        let rig = crate::rigs::find(name).unwrap();
        let lines = SightLines::new(&rig, 7, 6);
        let (mut seen, mut farthest, mut longest) = (0, 0.0f64, 0.0f64);
        for cell in 0..1500 {
            let pixel = DVec2::new(f64::from(cell * 211 % 768) + 0.5, f64::from(cell * 367 % 768) + 0.5);
            // The panel that the projector's ray meets first is the one that shows the pixel.
            let sights = (0..rig.mirror.face.len()).filter_map(|face| {
                let optics = |slice| SliceOptics::new(&rig, face, rig.slice_angle(slice), Model::Cone);
                Some((optics(7).sight(pixel)?, optics(7), optics(6)))
            });
            let sight = sights.min_by(|a, b| a.1.throw_m(a.0.mirror).total_cmp(&b.1.throw_m(b.0.mirror)));
            let (Some((sight, here, there)), Some(found)) = (sight, lines.at(pixel)) else { continue };
            assert!(here.pixel_of(sight).unwrap().distance(pixel) < 1e-6);
            let place = there.pixel_of(sight).unwrap();
            // The same line again, by another of its points.
            let other = there.mirror_of(place).unwrap();
            assert!(
                there.pixel_of(Sight { mirror: sight.mirror.midpoint(other), ..sight }).unwrap().distance(place) < 1e-6
            );
            seen += 1;
            farthest = farthest.max(found.distance(place));
            longest = longest.max(place.distance(pixel));
        }
        println!("{name}: {seen} pixels, {longest:.2} px at most between slices, {farthest:.4} px off by the grid");
        assert!(seen > 300 && farthest < 0.05 && longest > 2.0, "{name}: {seen} {farthest} {longest}");
    }
}
