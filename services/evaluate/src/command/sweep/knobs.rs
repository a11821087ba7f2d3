//! What a sweep varies: each knob alone around the set's own settings, and a few together.

use orime_capture::{SourceKind, ViewParams, Viewpoints};
use orime_geometry::SheetParams;
use orime_register::RegisterParams;
use orime_runtime::SetFile;
use orime_segment::SegmentParams;
use orime_simulate::{Effect, SimulateParams};
use serde::Serialize;
use toml::Value;

/// One setting that differs from the set.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// Its value, as it stands in tables and plots.
    pub value: String,
    /// Keys of the set file.
    pub keys: Vec<(String, Value)>,
    /// How many times the steps of the set's own run the same motion takes.
    pub steps_ratio: f64,
}

/// Something that can be set differently.
#[derive(Debug, Clone, PartialEq)]
pub struct Knob {
    /// Its name.
    pub name: &'static str,
    /// All values in their order, the set's own among them.
    pub values: Vec<String>,
    /// The set's own.
    pub own: String,
    /// The others.
    pub points: Vec<Point>,
}

/// The knobs whose settings see other data than the set's: another rate gives other frames.
pub const APART: [&str; 2] = ["frame rate [Hz]", "occlusion"];

/// What the knobs are turned around.
struct Own {
    sheet: SheetParams,
    capture: orime_capture::CaptureParams,
    segment: SegmentParams,
    register: RegisterParams,
    simulate: SimulateParams,
}

/// All knobs of a set.
pub fn all(set: &SetFile) -> anyhow::Result<Vec<Knob>> {
    let own = Own {
        sheet: set.section("sheet")?,
        capture: set.section("capture")?,
        segment: set.section("segment")?,
        register: set.section("register")?,
        simulate: set.section("simulate")?,
    };
    anyhow::ensure!(
        own.capture.source == SourceKind::Rendered,
        "`{}`: a sweep needs the true pose, which only `capture.source = \"rendered\"` knows",
        set.path.display()
    );
    let mut knobs = vec![grid(&own)];
    knobs.extend(numbers(&own));
    knobs.extend([links(&own), contact(&own), plasticity(&own)]);
    knobs.extend([cameras(&own)?, resolution(&own), rate(&own), occlusion(&own), together()]);
    Ok(knobs)
}

fn grid(own: &Own) -> Knob {
    let side = |[u, v]: [usize; 2]| if u == v { u.to_string() } else { format!("{u}x{v}") };
    let nodes = |n: usize| (n.to_string(), vec![pair("sheet.nodes", [n, n].map(|n| n as i64))]);
    let points = [13, 17, 19, 25, 31, 37, 49].map(nodes);
    Knob::new("grid [nodes]", side(own.sheet.nodes), points.into())
}

/// The knobs that are one number each.
fn numbers(own: &Own) -> Vec<Knob> {
    let Own { segment, register, simulate, .. } = own;
    let whole = |name, key: &str, own: f64, values: &[i64]| {
        let point = |v: &i64| (v.to_string(), vec![(key.to_owned(), Value::Integer(*v))]);
        Knob::new(name, own.to_string(), values.iter().map(point).collect())
    };
    let broken = |name, key: &str, own: f64, values: &[f64]| {
        let point = |v: &f64| (v.to_string(), vec![(key.to_owned(), Value::Float(*v))]);
        Knob::new(name, own.to_string(), values.iter().map(point).collect())
    };
    let iterations = f64::from(register.iterations_max);
    let sweeps = f64::from(register.isometry_sweeps);
    vec![
        whole("substeps", "simulate.substeps", f64::from(simulate.substeps), &[5, 10, 20, 40, 80]),
        whole("EM iterations", "register.iterations_max", iterations, &[2, 4, 8, 12, 20, 40]),
        whole(
            "points",
            "register.points_max",
            register.points_max as f64,
            &[250, 500, 1000, 2000, 4000],
        ),
        whole(
            "kernel rank",
            "register.modes_max",
            register.modes_max as f64,
            &[20, 40, 80, 120, 160],
        ),
        whole("isometry sweeps", "register.isometry_sweeps", sweeps, &[0, 3, 10, 20, 40]),
        broken(
            "control spacing",
            "register.control_spacing",
            register.control_spacing,
            &[0.167, 0.083, 0.042],
        ),
        broken(
            "virtual spacing",
            "register.virtual_spacing",
            register.virtual_spacing,
            &[0.042, 0.021, 0.014, 0.0105],
        ),
        broken("kernel width", "register.kernel_width", register.kernel_width, &[0.1, 0.2, 0.3]),
        broken(
            "contour weight",
            "register.outline_weight",
            register.outline_weight,
            &[0.0, 0.5, 1.0, 2.0],
        ),
        broken("voxel [m]", "segment.voxel_m", segment.voxel_m, &[0.002, 0.003, 0.005, 0.008]),
    ]
}

/// The point whose effects are these.
fn effects(value: &str, effects: Vec<Effect>) -> (String, Vec<(String, Value)>) {
    let names = effects.iter().map(|effect| Value::String(effect.name().to_owned())).collect();
    (value.to_owned(), vec![("simulate.effects".to_owned(), Value::Array(names))])
}

fn without(own: &Own, gone: &[Effect]) -> Vec<Effect> {
    own.simulate.effects.iter().copied().filter(|effect| !gone.contains(effect)).collect()
}

fn links(own: &Own) -> Knob {
    let reach = |n: i64| {
        (format!("reach {n}"), vec![("simulate.bend.reach".to_owned(), Value::Integer(n))])
    };
    let value = format!("reach {}", own.simulate.bend.reach);
    let mut points = vec![
        effects("axes", without(own, &[Effect::Shear, Effect::Bend])),
        effects("no bend", without(own, &[Effect::Bend])),
    ];
    points.extend([2, 3, 4].map(reach));
    Knob::new("links", value, points)
}

fn contact(own: &Own) -> Knob {
    let on_off = |on| if on { "on" } else { "off" }.to_owned();
    let has = own.simulate.effects.contains(&Effect::SelfContact);
    let mut with = without(own, &[Effect::SelfContact]);
    let off = effects("off", with.clone());
    with.push(Effect::SelfContact);
    Knob::new("contact", on_off(has), vec![off, effects("on", with)])
}

fn plasticity(own: &Own) -> Knob {
    let has = own.simulate.effects.contains(&Effect::Crease);
    let mut with = without(own, &[Effect::Crease]);
    let off = effects("off", with.clone());
    with.push(Effect::Crease);
    let value = if has { "on" } else { "off" };
    Knob::new("plasticity", value.to_owned(), vec![off, effects("on", with)])
}

/// One to five: the set's own, then those of the paper's five that it lacks.
fn cameras(own: &Own) -> anyhow::Result<Knob> {
    let rendered = &own.capture.rendered;
    let mut views: Vec<ViewParams> = match rendered.views.as_slice() {
        [] => rendered.viewpoints.views(),
        views => views.to_vec(),
    };
    let count = views.len();
    let others = Viewpoints::Five.views().into_iter();
    let others: Vec<ViewParams> =
        others.filter(|other| views.iter().all(|view| view.name != other.name)).collect();
    views.extend(others);
    views.extend(Viewpoints::Five.views().into_iter().filter_map(turned));
    let point = |n: usize| {
        let these = Value::try_from(&views[..n.min(views.len())])?;
        Ok((n.to_string(), vec![("capture.rendered.views".to_owned(), these)]))
    };
    // Eight are the most that a set may have.
    let points = (1..=5).chain([8]).map(point).collect::<Result<_, toml::ser::Error>>()?;
    Ok(Knob::new("cameras", count.to_string(), points))
}

/// One more camera like this one, a sixth of a turn further round the table; `None` for one above
/// or below its middle.
fn turned(view: ViewParams) -> Option<ViewParams> {
    let [x, y, z] = view.eye_m;
    let (sin, cos) = std::f64::consts::FRAC_PI_3.sin_cos();
    let eye_m = [cos * x - sin * y, sin * x + cos * y, z];
    (x != 0.0 || y != 0.0).then(|| ViewParams {
        name: format!("{} turned", view.name),
        eye_m,
        ..view
    })
}

fn resolution(own: &Own) -> Knob {
    let name = |[width, height]: [i64; 2]| format!("{width}x{height}");
    let point = |size: [i64; 2]| (name(size), vec![pair("capture.rendered.size_px", size)]);
    let points = [[160, 120], [320, 240], [640, 480], [1280, 720]].map(point);
    Knob::new("resolution", name(own.capture.rendered.size_px.map(i64::from)), points.into())
}

/// The same motion in more or fewer frames.
fn rate(own: &Own) -> Knob {
    let rendered = &own.capture.rendered;
    let mut knob = Knob::new(APART[0], rendered.rate_hz.to_string(), Vec::new());
    // A source is at most ten times slower or faster than usual.
    let is_possible = |ratio: &f64| (0.1..=10.0).contains(&(rendered.speed / ratio));
    for ratio in [0.25, 0.5, 2.0].into_iter().filter(is_possible) {
        let value = (rendered.rate_hz * ratio).to_string();
        let mut keys = vec![
            ("capture.rendered.rate_hz".to_owned(), Value::Float(rendered.rate_hz * ratio)),
            ("capture.rendered.speed".to_owned(), Value::Float(rendered.speed / ratio)),
        ];
        if let Some(steps) = rendered.steps {
            let steps = (steps as f64 * ratio).round() as i64;
            keys.push(("capture.rendered.steps".to_owned(), Value::Integer(steps)));
        }
        knob.points.push(Point { value, keys, steps_ratio: ratio });
    }
    knob.order()
}

/// How much of the sheet a bar hides from every camera.
fn occlusion(own: &Own) -> Knob {
    let has = own.capture.rendered.fault.occlusion.unwrap_or(0.0);
    let point = |share: f64| {
        let key = "capture.rendered.fault.occlusion".to_owned();
        (share.to_string(), vec![(key, Value::Float(share))])
    };
    Knob::new(APART[1], has.to_string(), [0.0, 0.25, 0.5, 0.75].map(point).into())
}

/// Cheap ones and dear ones together: what a front is made of.
fn together() -> Knob {
    let whole = |key: &str, v: i64| (format!("register.{key}"), Value::Integer(v));
    let broken = |key: &str, v: f64| (format!("register.{key}"), Value::Float(v));
    let image = pair("capture.rendered.size_px", [320, 240]);
    let substeps = |n: i64| ("simulate.substeps".to_owned(), Value::Integer(n));
    let voxel = |v: f64| ("segment.voxel_m".to_owned(), Value::Float(v));
    let lean = [whole("iterations_max", 6), whole("points_max", 1000)];
    let sparse =
        [whole("iterations_max", 4), whole("points_max", 500), broken("virtual_spacing", 0.042)];
    let rich = [whole("iterations_max", 20), whole("points_max", 4000), voxel(0.002)];
    let dense = [broken("virtual_spacing", 0.014), whole("modes_max", 160), substeps(40)];
    let points = vec![
        ("A lean", lean.to_vec()),
        ("B sparse", sparse.to_vec()),
        ("C sparse, small grid", [&sparse[..], &[pair("sheet.nodes", [19, 19])]].concat()),
        ("D lean, small image", [&lean[..], std::slice::from_ref(&image)].concat()),
        ("E sparse, small image", [&sparse[..], &[image, substeps(10)]].concat()),
        ("F rich", rich.to_vec()),
        ("G rich and dense", [&rich[..], &dense[..]].concat()),
    ];
    let points = points.into_iter().map(|(value, keys)| (value.to_owned(), keys)).collect();
    let mut knob = Knob::new("together", String::new(), points);
    knob.values.retain(|value| !value.is_empty());
    knob
}

fn pair(key: &str, values: [i64; 2]) -> (String, Value) {
    (key.to_owned(), Value::Array(values.map(Value::Integer).to_vec()))
}

impl Knob {
    /// A knob from what the set has and all its values; that which the set has is no point.
    fn new(name: &'static str, own: String, all: Vec<(String, Vec<(String, Value)>)>) -> Self {
        let mut values: Vec<String> = all.iter().map(|(value, _)| value.clone()).collect();
        if !values.contains(&own) {
            values.push(own.clone());
        }
        let others = all.into_iter().filter(|(value, _)| *value != own);
        let points = others.map(|(value, keys)| Point { value, keys, steps_ratio: 1.0 }).collect();
        Self { name, values, own, points }.sorted()
    }

    /// With the values of the points and the set's own, in order.
    fn order(mut self) -> Self {
        self.values = self.points.iter().map(|point| point.value.clone()).collect();
        self.values.push(self.own.clone());
        self.sorted()
    }

    /// Numbers by size, everything else as it came.
    fn sorted(mut self) -> Self {
        let number = |value: &String| value.parse::<f64>().ok();
        if self.values.iter().all(|value| number(value).is_some()) {
            self.values.sort_by(|a, b| {
                f64::total_cmp(&number(a).unwrap_or(0.0), &number(b).unwrap_or(0.0))
            });
        }
        self
    }
}

/// A knob as it is listed.
#[derive(Debug, Serialize)]
pub struct Listed<'a> {
    knob: &'a str,
    own: &'a str,
    values: &'a [String],
}

impl Knob {
    /// For lists.
    pub fn listed(&self) -> Listed<'_> {
        Listed { knob: self.name, own: &self.own, values: &self.values }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::command::variant::Variant;
    use std::path::Path;

    fn knobs(text: &str) -> anyhow::Result<Vec<Knob>> {
        all(&SetFile::parse(Path::new("set.toml"), text.to_owned()).unwrap())
    }

    const SET: &str = "name = \"x\"\npace = \"lockstep\"\n[capture]\nsource = \"rendered\"\n";

    #[test]
    fn every_point_is_a_set_that_opens_and_differs_from_its_own() {
        let set = SetFile::parse(Path::new("set.toml"), SET.to_owned()).unwrap();
        let own = format!("{:?}", crate::command::set::pipeline(&set).unwrap());
        let views = |set: &SetFile| {
            let capture: orime_capture::CaptureParams = set.section("capture").unwrap();
            assert!(capture.check().is_ok());
            capture
        };
        for knob in all(&set).unwrap() {
            assert!(knob.own.is_empty() || knob.values.contains(&knob.own), "{}", knob.name);
            for point in knob.points {
                let name = format!("{} {}", knob.name, point.value);
                let text = Variant::new(name.clone(), point.keys).apply(SET).unwrap();
                let varied = SetFile::parse(Path::new("set.toml"), text).unwrap();
                let pipeline = format!("{:?}", crate::command::set::pipeline(&varied).unwrap());
                let same = pipeline == own && views(&varied) == views(&set);
                assert!(!same, "{name} changes nothing");
            }
        }
    }

    #[test]
    fn a_value_that_the_set_has_is_not_run_again_and_others_are_put_in_order() {
        let text = format!("{SET}[register]\niterations_max = 10\npoints_max = 1000\n");
        let knobs = knobs(&text).unwrap();
        let of = |name| knobs.iter().find(|knob| knob.name == name).unwrap();
        assert_eq!(of("EM iterations").values, ["2", "4", "8", "10", "12", "20", "40"]);
        assert_eq!(of("EM iterations").points.len(), 6);
        assert_eq!(of("points").points.len(), 4);
        assert_eq!((of("cameras").own.as_str(), of("cameras").points.len()), ("3", 5));
    }

    #[test]
    fn rates_that_no_source_can_give_are_left_out() {
        let text = format!("{SET}[capture.rendered]\nspeed = 4.0\n");
        let knobs = knobs(&text).unwrap();
        let rates = knobs.iter().find(|knob| knob.name == APART[0]).unwrap();
        assert_eq!(rates.values, ["15", "30", "60"]);
    }

    #[test]
    fn a_set_without_truth_is_refused() {
        let text = SET.replace("rendered", "folder");
        let error = knobs(&text).unwrap_err().to_string();
        assert!(error.contains("set.toml") && error.contains("rendered"), "{error}");
    }
}
