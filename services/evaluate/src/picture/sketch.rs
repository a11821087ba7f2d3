//! Lines, dots and words, described once and drawn as SVG and as PNG.

use std::fmt::Write as _;
use std::io;
use std::path::Path;

use super::canvas::{Canvas, Color};

/// Where a word stands relative to its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    /// It begins there.
    Start,
    /// Its middle is there.
    Middle,
    /// It ends there.
    End,
}

#[derive(Debug, Clone)]
enum Mark {
    Line { ends: [[f64; 2]; 2], color: Color, width: f64 },
    Dot { at: [f64; 2], radius: f64, color: Color },
    Text { at: [f64; 2], anchor: Anchor, color: Color, words: String },
}

/// A drawing, in units of which the PNG has two pixels each.
#[derive(Debug, Clone)]
pub struct Sketch {
    size: [f64; 2],
    marks: Vec<Mark>,
}

/// Pixels per unit in the PNG.
const SCALE: f64 = 2.0;
/// Width of a character in the PNG's font, units.
pub const CHARACTER: f64 = 8.0;

impl Sketch {
    /// An empty white sheet.
    pub fn new(size: [f64; 2]) -> Self {
        Self { size, marks: Vec::new() }
    }

    /// A straight line.
    pub fn line(&mut self, from: [f64; 2], to: [f64; 2], color: Color, width: f64) {
        self.marks.push(Mark::Line { ends: [from, to], color, width });
    }

    /// A filled disc.
    pub fn dot(&mut self, at: [f64; 2], radius: f64, color: Color) {
        self.marks.push(Mark::Dot { at, radius, color });
    }

    /// Words; `at` is on their base line. The PNG knows ASCII alone.
    pub fn text(&mut self, at: [f64; 2], anchor: Anchor, color: Color, words: &str) {
        self.marks.push(Mark::Text { at, anchor, color, words: words.to_owned() });
    }

    /// Writes `STEM.svg` and `STEM.png`.
    pub fn save(&self, stem: &Path) -> io::Result<()> {
        std::fs::write(stem.with_extension("svg"), self.svg())?;
        self.canvas().save(&stem.with_extension("png"))
    }

    /// The drawing as SVG.
    pub fn svg(&self) -> String {
        let [width, height] = self.size;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" \
             font-family=\"sans-serif\" font-size=\"12\">\n\
             <rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"
        );
        let rgb = |[r, g, b]: Color| format!("rgb({r},{g},{b})");
        for mark in &self.marks {
            // Writing to a string cannot fail.
            let _ = match mark {
                Mark::Line { ends: [[x1, y1], [x2, y2]], color, width } => writeln!(
                    svg,
                    "<path d=\"M{x1:.1} {y1:.1}L{x2:.1} {y2:.1}\" stroke=\"{}\" \
                     stroke-width=\"{width}\"/>",
                    rgb(*color)
                ),
                Mark::Dot { at: [x, y], radius, color } => writeln!(
                    svg,
                    "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" fill=\"{}\"/>",
                    rgb(*color)
                ),
                Mark::Text { at: [x, y], anchor, color, words } => writeln!(
                    svg,
                    "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{}\" fill=\"{}\">{}</text>",
                    match anchor {
                        Anchor::Start => "start",
                        Anchor::Middle => "middle",
                        Anchor::End => "end",
                    },
                    rgb(*color),
                    words.replace('&', "&amp;").replace('<', "&lt;")
                ),
            };
        }
        svg + "</svg>\n"
    }

    fn canvas(&self) -> Canvas {
        let [width, height] = self.size.map(|side| (SCALE * side) as usize);
        let mut canvas = Canvas::new(width, height, [255; 3]);
        for mark in &self.marks {
            match mark {
                Mark::Line { ends, color, width } => {
                    let [from, to] = ends.map(|end| end.map(|c| c * SCALE));
                    // Beside each other, as many as the line is wide.
                    for k in 0..(width * SCALE).round().max(1.0) as usize {
                        let aside = |[x, y]: [f64; 2]| match (to[0] - from[0]).abs() {
                            across if across > (to[1] - from[1]).abs() => [x, y + k as f64],
                            _ => [x + k as f64, y],
                        };
                        canvas.line(aside(from), aside(to), *color, 1.0);
                    }
                }
                Mark::Dot { at, radius, color } => disc(&mut canvas, *at, *radius, *color),
                Mark::Text { at: [x, y], anchor, color, words } => {
                    let long = CHARACTER * words.chars().count() as f64;
                    let left = match anchor {
                        Anchor::Start => *x,
                        Anchor::Middle => x - long / 2.0,
                        Anchor::End => x - long,
                    };
                    let top = SCALE * (y - CHARACTER);
                    let [left, top] = [SCALE * left, top].map(|c| c.max(0.0) as usize);
                    canvas.text(left, top, words, SCALE as usize, *color);
                }
            }
        }
        canvas
    }
}

fn disc(canvas: &mut Canvas, at: [f64; 2], radius: f64, color: Color) {
    let [x, y] = at.map(|c| c * SCALE);
    let reach = (radius * SCALE).ceil() as i64;
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            if (dx as f64).hypot(dy as f64) <= radius * SCALE {
                canvas.set(x.round() as i64 + dx, y.round() as i64 + dy, color);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_drawings_show_every_mark() {
        let mut sketch = Sketch::new([40.0, 20.0]);
        sketch.line([5.0, 5.0], [35.0, 5.0], [255, 0, 0], 1.0);
        sketch.dot([10.0, 12.0], 3.0, [0, 255, 0]);
        sketch.text([39.0, 18.0], Anchor::End, [0, 0, 255], "<");
        let svg = sketch.svg();
        assert!(svg.contains("<path") && svg.contains("<circle") && svg.contains("&lt;"), "{svg}");
        let canvas = sketch.canvas();
        assert_eq!((canvas.get(30, 10), canvas.get(30, 11)), ([255, 0, 0], [255, 0, 0]));
        assert_eq!((canvas.get(20, 24), canvas.get(20, 17)), ([0, 255, 0], [255; 3]));
        let blue = |x: usize| (0..40).any(|y| canvas.get(x, y) == [0, 0, 255]);
        assert!((62..78).any(blue) && !(0..60).any(blue), "the word ends at its place");
    }
}
