//! Pictures of a sweep: error over time with the front, and one small plot per knob.

use super::canvas::Color;
use super::sketch::{Anchor, CHARACTER, Sketch};
use crate::sweep::{Setting, front, place};

const BLACK: Color = [30; 3];
const GREY: Color = [150; 3];
const PALE: Color = [225; 3];
const BLUE: Color = [0, 114, 178];
const ORANGE: Color = [213, 94, 0];
const GREEN: Color = [0, 130, 90];

/// Somebody else's figures, drawn beside ours.
#[derive(Debug, Clone)]
pub struct Landmark {
    /// Its name.
    pub name: String,
    /// From and to, milliseconds per step.
    pub step_ms: [f64; 2],
    /// From and to, millimetres; `None` where only its time is known.
    pub error_mm: Option<[f64; 2]>,
}

/// A logarithmic axis over part of the drawing.
struct Log {
    from: f64,
    to: f64,
    at: [f64; 2],
}

impl Log {
    /// Over all positive values, with some room.
    fn over(values: impl Iterator<Item = f64>, at: [f64; 2]) -> Self {
        let wide = |[low, high]: [f64; 2], v: f64| [low.min(v), high.max(v)];
        let [low, high] =
            values.filter(|v| v.is_finite() && *v > 0.0).fold([f64::INFINITY, 0.0], wide);
        let [low, high] = if low <= high { [low, high] } else { [1.0, 10.0] };
        Self { from: low / 1.3, to: high * 1.3, at }
    }

    fn place(&self, value: f64) -> f64 {
        let share = (value / self.from).ln() / (self.to / self.from).ln();
        self.at[0] + (self.at[1] - self.at[0]) * share.clamp(0.0, 1.0)
    }

    /// 1, 2 and 5 of every decade.
    fn ticks(&self) -> Vec<f64> {
        let decades = self.from.log10().floor() as i32..=self.to.log10().ceil() as i32;
        let all = decades.flat_map(|d| [1.0, 2.0, 5.0].map(|n| n * 10f64.powi(d)));
        all.filter(|v| self.from <= *v && *v <= self.to).collect()
    }
}

/// Error over time per step, both logarithmic: every setting, the Pareto front, and landmarks.
/// Settings of the knobs in `apart` are drawn grey: they saw other data.
pub fn over_time(
    title: &str,
    settings: &[Setting],
    apart: &[&str],
    landmarks: &[Landmark],
) -> Sketch {
    const SIZE: [f64; 2] = [1240.0, 600.0];
    let [left, right, top, bottom] = [64.0, SIZE[0] - 300.0, 52.0, SIZE[1] - 46.0];
    let times = landmarks.iter().flat_map(|l| l.step_ms);
    let errors = landmarks.iter().filter_map(|l| l.error_mm).flatten();
    let x = Log::over(settings.iter().map(|s| s.step_ms.min).chain(times), [left, right]);
    let spreads = settings.iter().flat_map(|s| [s.vertex_error_mm.min, s.vertex_error_mm.max]);
    let y = Log::over(spreads.chain(errors), [bottom, top]);
    let mut sketch = Sketch::new(SIZE);
    sketch.text([left, 20.0], Anchor::Start, BLACK, title);
    sketch.text([left, 40.0], Anchor::Start, GREY, "true vertex error, mean [mm]; bars: seeds");
    let label = "time per step: segment + register + simulate, median of the fastest run [ms]";
    sketch.text([(left + right) / 2.0, SIZE[1] - 8.0], Anchor::Middle, BLACK, label);
    for value in x.ticks() {
        let at = x.place(value);
        sketch.line([at, top], [at, bottom], PALE, 0.5);
        sketch.text([at, bottom + 16.0], Anchor::Middle, BLACK, &number(value));
    }
    for value in y.ticks() {
        let at = y.place(value);
        sketch.line([left, at], [right, at], PALE, 0.5);
        sketch.text([left - 6.0, at + 4.0], Anchor::End, BLACK, &number(value));
    }
    for landmark in landmarks {
        draw_landmark(&mut sketch, landmark, &x, &y);
    }
    draw_settings(&mut sketch, settings, apart, &x, &y);
    let names = draw_front(&mut sketch, settings, &x, &y);
    let legend = [
        (ORANGE, "Pareto front, by time:"),
        (BLACK, "the set's own settings"),
        (BLUE, "one knob, or a few, changed"),
        (GREY, "other data: frame rate, occlusion"),
    ];
    for (k, (color, words)) in legend.iter().rev().enumerate() {
        let at = [right + 24.0, bottom - 16.0 * k as f64];
        sketch.dot([at[0] - 9.0, at[1] - 4.0], 3.5, *color);
        sketch.text(at, Anchor::Start, BLACK, words);
    }
    for (k, name) in names.iter().enumerate() {
        let at = [right + 15.0, top + 10.0 + 16.0 * k as f64];
        sketch.text(at, Anchor::Start, BLACK, &format!("{} {name}", k + 1));
    }
    sketch
}

fn draw_landmark(sketch: &mut Sketch, landmark: &Landmark, x: &Log, y: &Log) {
    let [from, to] = landmark.step_ms.map(|ms| x.place(ms));
    let [low, high] = landmark.error_mm.map_or(y.at, |mm| mm.map(|mm| y.place(mm)));
    for side in [from, to] {
        sketch.line([side, low], [side, high], GREEN, 1.5);
    }
    if landmark.error_mm.is_some() {
        for side in [low, high] {
            sketch.line([from, side], [to, side], GREEN, 1.5);
        }
    }
    let at = if landmark.error_mm.is_some() { high - 6.0 } else { y.at[1] + 14.0 };
    let is_right = to + CHARACTER * landmark.name.len() as f64 > x.at[1];
    let (at, anchor) =
        if is_right { ([from - 6.0, at], Anchor::End) } else { ([to + 6.0, at], Anchor::Start) };
    sketch.text(at, anchor, GREEN, &landmark.name);
}

fn draw_settings(sketch: &mut Sketch, settings: &[Setting], apart: &[&str], x: &Log, y: &Log) {
    let is_base = |setting: &Setting| setting.knob == "base";
    // The set's own last: nothing hides it.
    let (own, others): (Vec<&Setting>, Vec<&Setting>) = settings.iter().partition(|s| is_base(s));
    for setting in others.into_iter().chain(own) {
        let [ms, mm] = place(setting);
        let (at, spread) = ([x.place(ms), y.place(mm)], setting.vertex_error_mm);
        let color = match setting {
            s if apart.contains(&s.knob.as_str()) => GREY,
            s if is_base(s) => BLACK,
            _ => BLUE,
        };
        sketch.line([at[0], y.place(spread.min)], [at[0], y.place(spread.max)], color, 0.5);
        sketch.dot(at, if is_base(setting) { 5.0 } else { 3.0 }, color);
    }
}

/// The front with numbers; the names that these stand for.
fn draw_front(sketch: &mut Sketch, settings: &[Setting], x: &Log, y: &Log) -> Vec<String> {
    let on_front: Vec<&Setting> = settings.iter().filter(|s| s.on_front).collect();
    let places: Vec<[f64; 2]> = on_front.iter().map(|s| place(s)).collect();
    let order = front(&places);
    let at = |k: usize| [x.place(places[k][0]), y.place(places[k][1])];
    for pair in order.windows(2) {
        // Nothing measured lies between two of the front: it goes by steps.
        let [a, b] = [at(pair[0]), at(pair[1])];
        sketch.line(a, [b[0], a[1]], ORANGE, 1.0);
        sketch.line([b[0], a[1]], b, ORANGE, 1.0);
    }
    for (n, k) in order.iter().enumerate() {
        let [px, py] = at(*k);
        sketch.dot([px, py], 3.5, ORANGE);
        sketch.text([px - 3.0, py + 16.0], Anchor::End, BLACK, &(n + 1).to_string());
    }
    order.into_iter().map(|k| on_front[k].name()).collect()
}

/// Width and height of one knob's plot.
const PANEL: [f64; 2] = [320.0, 220.0];

/// One small plot per knob: error (blue, left, with the seeds' range) and time (orange, right)
/// over its values, of which the one that the set has is marked. `knobs`: name, values in their
/// order, and which of these the set has.
pub fn knob_plots(
    title: &str,
    knobs: &[(String, Vec<String>, String)],
    settings: &[Setting],
) -> Sketch {
    const COLUMNS: usize = 3;
    let rows = knobs.len().div_ceil(COLUMNS).max(1);
    let mut sketch = Sketch::new([PANEL[0] * COLUMNS as f64, 30.0 + PANEL[1] * rows as f64]);
    sketch.text([8.0, 20.0], Anchor::Start, BLACK, title);
    let base = settings.iter().find(|s| s.knob == "base");
    for (k, (name, values, own)) in knobs.iter().enumerate() {
        let corner = [PANEL[0] * (k % COLUMNS) as f64, 30.0 + PANEL[1] * (k / COLUMNS) as f64];
        let of = |value: &String| {
            if value == own {
                return base;
            }
            settings.iter().find(|s| s.knob == *name && s.value == *value)
        };
        let points: Vec<(&str, Option<&Setting>)> =
            values.iter().map(|value| (value.as_str(), of(value))).collect();
        panel(&mut sketch, corner, name, &points, own);
    }
    sketch
}

fn panel(
    sketch: &mut Sketch,
    corner: [f64; 2],
    name: &str,
    points: &[(&str, Option<&Setting>)],
    own: &str,
) {
    let [left, right] = [corner[0] + 48.0, corner[0] + PANEL[0] - 48.0];
    let [top, bottom] = [corner[1] + 34.0, corner[1] + PANEL[1] - 24.0];
    sketch.text([left, corner[1] + 14.0], Anchor::Start, BLACK, name);
    sketch.text([left - 40.0, corner[1] + 28.0], Anchor::Start, BLUE, "mm");
    sketch.text([right + 40.0, corner[1] + 28.0], Anchor::End, ORANGE, "ms");
    let known = || points.iter().filter_map(|(_, setting)| *setting);
    let most = |figure: fn(&Setting) -> f64| known().map(figure).fold(1e-9, f64::max) * 1.1;
    let (mm_max, ms_max) = (most(|s| s.vertex_error_mm.max), most(|s| s.step_ms.min));
    let y = |value: f64, max: f64| bottom - (bottom - top) * (value / max).clamp(0.0, 1.0);
    for share in [0.0, 0.5, 1.0] {
        let at = bottom - (bottom - top) * share;
        sketch.line([left, at], [right, at], PALE, 0.5);
        sketch.text([left - 4.0, at + 4.0], Anchor::End, BLUE, &number(mm_max * share));
        sketch.text([right + 4.0, at + 4.0], Anchor::Start, ORANGE, &number(ms_max * share));
    }
    let x = |k: usize| left + (right - left) * (k as f64 + 0.5) / points.len().max(1) as f64;
    let mut before: Option<[[f64; 2]; 2]> = None;
    for (k, (value, setting)) in points.iter().enumerate() {
        let color = if *value == own { BLACK } else { GREY };
        // Long names take turns on two lines.
        let room = (right - left) / points.len() as f64;
        let is_tight = points.iter().any(|(v, _)| CHARACTER * v.len() as f64 > room - 4.0);
        let low = if is_tight && k % 2 == 1 { 20.0 } else { 11.0 };
        sketch.text([x(k), bottom + low], Anchor::Middle, color, value);
        let Some(setting) = setting else { continue };
        let error = setting.vertex_error_mm;
        let now = [[x(k), y(setting.step_ms.min, ms_max)], [x(k), y(error.mean, mm_max)]];
        if let Some(before) = before {
            sketch.line(before[0], now[0], ORANGE, 1.0);
            sketch.line(before[1], now[1], BLUE, 1.0);
        }
        sketch.line([x(k), y(error.min, mm_max)], [x(k), y(error.max, mm_max)], BLUE, 0.5);
        let radius = if *value == own { 4.5 } else { 2.5 };
        sketch.dot(now[0], radius, ORANGE);
        sketch.dot(now[1], radius, BLUE);
        before = Some(now);
    }
}

/// Three digits at most.
fn number(value: f64) -> String {
    let digits = match value.abs() {
        v if v >= 100.0 => 0,
        v if v >= 10.0 => 1,
        _ => 2,
    };
    let text = format!("{value:.digits$}");
    let is_fraction = text.contains('.');
    if is_fraction { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_logarithmic_with_round_numbers() {
        let axis = Log::over([1.0, 100.0, 0.0, f64::NAN].into_iter(), [0.0, 100.0]);
        assert!((axis.place(10.0) - 50.0).abs() < 1e-9);
        assert_eq!(axis.ticks(), [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0]);
        assert_eq!([0.05, 12.34, 240.0, 20.0].map(number), ["0.05", "12.3", "240", "20"]);
    }
}
