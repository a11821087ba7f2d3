//! A line plot, as SVG and as PNG from the same description.

use std::fmt::Write as _;
use std::io;
use std::path::Path;

use super::canvas::{Canvas, Color};

/// One line of a plot; steps without a value break it.
#[derive(Debug, Clone)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// Values by x.
    pub points: Vec<(f64, Option<f64>)>,
    /// Drawn thin and grey: a reference.
    pub is_reference: bool,
}

/// A line plot.
#[derive(Debug, Clone)]
pub struct Plot {
    /// Above the plot.
    pub title: String,
    /// Below the x axis.
    pub x_label: String,
    /// At the y axis.
    pub y_label: String,
    /// Lines, drawn in this order.
    pub series: Vec<Series>,
}

const SIZE: [f64; 2] = [960.0, 420.0];
/// Left, top, right, bottom.
const MARGIN: [f64; 4] = [64.0, 36.0, 16.0, 46.0];
/// Distinct in print and for most kinds of colour blindness (Okabe & Ito).
const COLORS: [Color; 6] =
    [[0, 114, 178], [213, 94, 0], [0, 158, 115], [204, 121, 167], [230, 159, 0], [86, 180, 233]];
const GREY: Color = [150, 150, 150];

struct Axes {
    x: [f64; 2],
    y: [f64; 2],
}

impl Plot {
    /// Writes `STEM.svg` and `STEM.png`.
    pub fn save(&self, stem: &Path) -> io::Result<()> {
        std::fs::write(stem.with_extension("svg"), self.svg())?;
        self.canvas().save(&stem.with_extension("png"))
    }

    fn axes(&self) -> Axes {
        let points = || self.series.iter().flat_map(|s| &s.points);
        let xs = points().map(|p| p.0);
        let (low, high) =
            xs.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
        let x = if low < high { [low, high] } else { [0.0, 1.0] };
        let mut ys: Vec<f64> = points().filter_map(|p| p.1).filter(|y| y.is_finite()).collect();
        ys.sort_by(f64::total_cmp);
        // A few spikes must not flatten everything else: they are cut at twice the 98th percentile.
        let top = ys.last().copied().unwrap_or(1.0);
        let usual = crate::scores::percentile(&ys, 0.98).unwrap_or(1.0);
        Axes { x, y: [0.0, top.min(2.0 * usual).max(1e-9) * 1.05] }
    }

    /// The plot as SVG.
    pub fn svg(&self) -> String {
        let axes = self.axes();
        let [width, height] = SIZE;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" \
             font-family=\"sans-serif\" font-size=\"13\">\n\
             <rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"
        );
        let mut text = |x: f64, y: f64, anchor: &str, fill: Color, words: &str| {
            let words = words.replace('&', "&amp;").replace('<', "&lt;");
            let [r, g, b] = fill;
            let _ = writeln!(
                svg,
                "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" \
                 fill=\"rgb({r},{g},{b})\">{words}</text>"
            );
        };
        let black = [30; 3];
        text(MARGIN[0], 22.0, "start", black, &self.title);
        text(width / 2.0, height - 10.0, "middle", black, &self.x_label);
        text(MARGIN[0], MARGIN[1] + 14.0, "start", GREY, &self.y_label);
        for (value, at) in axes.x_ticks() {
            text(at, height - MARGIN[3] + 17.0, "middle", black, &tick(value));
        }
        for (value, at) in axes.y_ticks() {
            text(MARGIN[0] - 6.0, at + 4.0, "end", black, &tick(value));
        }
        for (k, (series, color)) in self.colored().enumerate() {
            let y = MARGIN[1] + 14.0 + 18.0 * k as f64;
            text(width - MARGIN[2] - 4.0, y, "end", color, &series.name);
        }
        for (_, at) in axes.y_ticks() {
            let (left, right) = (MARGIN[0], width - MARGIN[2]);
            let _ = writeln!(
                svg,
                "<path d=\"M{left} {at:.1}H{right}\" stroke=\"#ddd\" stroke-width=\"1\"/>"
            );
        }
        for (series, [r, g, b]) in self.colored() {
            let stroke = if series.is_reference { 1.0 } else { 1.8 };
            for line in axes.polylines(series) {
                let points: Vec<String> =
                    line.iter().map(|p| format!("{:.1},{:.1}", p[0], p[1])).collect();
                let _ = writeln!(
                    svg,
                    "<polyline fill=\"none\" stroke=\"rgb({r},{g},{b})\" \
                     stroke-width=\"{stroke}\" points=\"{}\"/>",
                    points.join(" ")
                );
            }
        }
        svg + "</svg>\n"
    }

    fn canvas(&self) -> Canvas {
        const SCALE: f64 = 2.0;
        let axes = self.axes();
        let mut canvas =
            Canvas::new((SCALE * SIZE[0]) as usize, (SCALE * SIZE[1]) as usize, [255; 3]);
        let black = [30; 3];
        let mut text = |x: f64, y: f64, words: &str, color: Color| {
            canvas.text((SCALE * x) as usize, (SCALE * y) as usize, words, 2, color);
        };
        text(MARGIN[0], 10.0, &self.title, black);
        text(SIZE[0] / 2.0 - 4.0 * self.x_label.len() as f64, SIZE[1] - 18.0, &self.x_label, black);
        text(MARGIN[0] + 4.0, MARGIN[1] + 4.0, &self.y_label, GREY);
        for (value, at) in axes.x_ticks() {
            let label = tick(value);
            text(at - 4.0 * label.len() as f64, SIZE[1] - MARGIN[3] + 8.0, &label, black);
        }
        for (value, at) in axes.y_ticks() {
            let label = tick(value);
            text(MARGIN[0] - 8.0 - 8.0 * label.len() as f64, at - 4.0, &label, black);
        }
        for (k, (series, color)) in self.colored().enumerate() {
            let x = SIZE[0] - MARGIN[2] - 8.0 * series.name.chars().count() as f64 - 4.0;
            text(x, MARGIN[1] + 4.0 + 14.0 * k as f64, &series.name, color);
        }
        let scaled = |p: [f64; 2]| p.map(|c| c * SCALE);
        for (_, at) in axes.y_ticks() {
            let ends = [[MARGIN[0], at], [SIZE[0] - MARGIN[2], at]].map(scaled);
            canvas.line(ends[0], ends[1], [221; 3], 1.0);
        }
        for (series, color) in self.colored() {
            for line in axes.polylines(series) {
                for pair in line.windows(2) {
                    let [a, b] = [scaled(pair[0]), scaled(pair[1])];
                    canvas.line(a, b, color, 1.0);
                    if !series.is_reference {
                        canvas.line([a[0], a[1] + 1.0], [b[0], b[1] + 1.0], color, 1.0);
                    }
                }
            }
        }
        canvas
    }

    fn colored(&self) -> impl Iterator<Item = (&Series, Color)> {
        let mut next = 0;
        self.series.iter().map(move |series| {
            if series.is_reference {
                return (series, GREY);
            }
            next += 1;
            (series, COLORS[(next - 1) % COLORS.len()])
        })
    }
}

impl Axes {
    fn place(&self, x: f64, y: f64) -> [f64; 2] {
        let share = |value: f64, [low, high]: [f64; 2]| (value - low) / (high - low);
        let across = SIZE[0] - MARGIN[0] - MARGIN[2];
        let up = SIZE[1] - MARGIN[1] - MARGIN[3];
        [
            MARGIN[0] + across * share(x, self.x),
            SIZE[1] - MARGIN[3] - up * share(y, self.y).clamp(0.0, 1.0),
        ]
    }

    fn x_ticks(&self) -> Vec<(f64, f64)> {
        ticks(self.x).into_iter().map(|x| (x, self.place(x, 0.0)[0])).collect()
    }

    fn y_ticks(&self) -> Vec<(f64, f64)> {
        ticks(self.y).into_iter().map(|y| (y, self.place(0.0, y)[1])).collect()
    }

    /// The series' unbroken runs.
    fn polylines(&self, series: &Series) -> Vec<Vec<[f64; 2]>> {
        let mut lines = vec![Vec::new()];
        for (x, y) in &series.points {
            match y.filter(|y| y.is_finite()) {
                Some(y) => {
                    let at = self.place(*x, y);
                    lines.last_mut().expect("there is always one").push(at);
                }
                None => lines.push(Vec::new()),
            }
        }
        lines.retain(|line| line.len() > 1);
        lines
    }
}

/// About six round numbers in a range.
fn ticks([low, high]: [f64; 2]) -> Vec<f64> {
    let rough = (high - low) / 6.0;
    let magnitude = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|s| s * magnitude)
        .find(|s| *s >= rough)
        .unwrap_or(10.0 * magnitude);
    let first = (low / step).ceil() as i64;
    let last = (high / step).floor() as i64;
    (first..=last).map(|k| k as f64 * step).collect()
}

fn tick(value: f64) -> String {
    let text = format!("{value:.3}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_gaps_break_the_line() {
        assert_eq!(ticks([0.0, 580.0]), [0.0, 100.0, 200.0, 300.0, 400.0, 500.0]);
        assert_eq!(tick(0.5), "0.5");
        let points = vec![(0.0, Some(1.0)), (1.0, Some(2.0)), (2.0, None), (3.0, Some(1.0))];
        let series = Series { name: "a < b".into(), points, is_reference: false };
        let plot = Plot {
            title: "t".into(),
            x_label: "x".into(),
            y_label: "y".into(),
            series: vec![series],
        };
        assert_eq!(plot.axes().polylines(&plot.series[0]).len(), 1);
        let svg = plot.svg();
        assert!(svg.contains("a &lt; b") && svg.matches("<polyline").count() == 1, "{svg}");
        let empty = Plot { series: Vec::new(), ..plot };
        assert!(empty.svg().ends_with("</svg>\n"));
    }
}
