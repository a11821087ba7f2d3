//! What `track` and `watch` write.

use anyhow::Context;
use orime_evaluate::judge::Judge;
use orime_evaluate::picture::{PanelInput, panel};
use orime_evaluate::summary::{Range, StepScore, Summary};
use serde::Serialize;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// A run's figures: the summary's fields, and those of every step under `per_step`.
#[derive(Debug, Serialize)]
struct Report<'a> {
    set: &'a str,
    #[serde(flatten)]
    summary: &'a Summary,
    per_step: &'a [StepScore],
}

/// Writes `FILE`: a run's figures as JSON.
pub fn write_json(path: &Path, set: &str, judge: &Judge) -> anyhow::Result<()> {
    let summary = judge.summary();
    let report = Report { set, summary: &summary, per_step: judge.steps() };
    let text = serde_json::to_string_pretty(&report)?;
    std::fs::write(path, text + "\n").with_context(|| format!("writing `{}`", path.display()))
}

/// Writes `FILE`: one line per step.
pub fn write_csv(path: &Path, steps: &[StepScore]) -> anyhow::Result<()> {
    let mut text = String::from(
        "step,tracking,reset,points,e_mm,surface_mm,strain_percent,strain_percent_max,\
         planarity_mm_rms,outline_px_median,vertex_error_mm_mean,vertex_error_mm_p95,\
         vertex_error_mm_max,offset_x_mm,offset_y_mm,offset_z_mm,shape_error_mm,\
         e_at_truth_mm,chamfer_mm,vertex_error_visible_mm,\
         vertex_error_hidden_mm,wrinkle_deg,crease_angle_error_deg,crease_position_error_mm,\
         self_intersections,layer_pairs,layer_pairs_wrong,\
         segment_ms,register_ms,simulate_ms,state_hash\n",
    );
    for s in steps {
        write!(text, "{},{},{},{}", s.step, s.tracking, s.reset, s.points)?;
        for figure in [
            s.e_mm,
            s.surface_mm,
            s.strain_percent,
            s.strain_percent_max,
            s.planarity_mm_rms,
            s.outline_px_median,
            s.vertex_error_mm_mean,
            s.vertex_error_mm_p95,
            s.vertex_error_mm_max,
            s.offset_mm.map(|offset| offset[0]),
            s.offset_mm.map(|offset| offset[1]),
            s.offset_mm.map(|offset| offset[2]),
            s.shape_error_mm,
            s.e_at_truth_mm,
            s.chamfer_mm,
            s.vertex_error_visible_mm,
            s.vertex_error_hidden_mm,
            s.wrinkle_deg,
            s.crease_angle_error_deg,
            s.crease_position_error_mm,
            s.self_intersections.map(|n| n as f64),
            s.layer_order.map(|order| f64::from(order.pairs)),
            s.layer_order.map(|order| f64::from(order.wrong)),
        ] {
            match figure {
                Some(value) => write!(text, ",{value:.4}")?,
                None => text.push(','),
            }
        }
        writeln!(
            text,
            ",{:.3},{:.3},{:.3},{}",
            s.ms.segment, s.ms.register, s.ms.simulate, s.state_hash
        )?;
    }
    std::fs::write(path, text).with_context(|| format!("writing `{}`", path.display()))
}

/// Which steps get a picture, and where it goes.
#[derive(Debug)]
pub struct Pictures {
    directory: PathBuf,
    every: u64,
    /// First step that gets the next picture: a step that was dropped costs none.
    due: u64,
    /// These steps and no others, where there are any.
    at: Vec<u64>,
    /// Index of the camera whose image is shown.
    pub camera: usize,
    written: u64,
}

impl Pictures {
    /// Makes the directory. `every`: 0 gives about sixteen pictures of `steps`.
    pub fn new(directory: &Path, every: u64, steps: u64, camera: usize) -> anyhow::Result<Self> {
        std::fs::create_dir_all(directory)
            .with_context(|| format!("making the folder `{}`", directory.display()))?;
        let every = if every > 0 { every } else { steps.div_ceil(16).max(1) };
        Ok(Self {
            directory: directory.to_owned(),
            every,
            due: 0,
            at: Vec::new(),
            camera,
            written: 0,
        })
    }

    /// Pictures at these steps and no others; no change where there are none.
    pub fn at(self, steps: &[u64]) -> Self {
        Self { at: steps.to_vec(), ..self }
    }

    /// Whether `step` gets a picture.
    pub fn wants(&self, step: u64) -> bool {
        if self.at.is_empty() { step >= self.due } else { self.at.contains(&step) }
    }

    /// Draws and writes one.
    pub fn write(&mut self, input: &PanelInput<'_>) -> anyhow::Result<()> {
        let path = self.directory.join(format!("step_{:04}.png", input.score.step));
        panel(input).save(&path).with_context(|| format!("writing `{}`", path.display()))?;
        self.due = (input.score.step / self.every + 1) * self.every;
        self.written += 1;
        Ok(())
    }

    /// Number of pictures and where they are.
    pub fn written(&self) -> (u64, &Path) {
        (self.written, &self.directory)
    }
}

/// The summary for people, one figure a line.
pub fn table(set: &str, summary: &Summary) -> String {
    let mut lines = vec![
        format!("set                        {set}"),
        format!(
            "steps                      {} ({} lost, {} of them unnoticed; {} coasting; {} poses \
             taken)",
            summary.steps,
            summary.lost_steps,
            summary.lost_steps_unnoticed,
            summary.coasting_steps,
            summary.resets
        ),
        format!(
            "E (Eq. 5)                  {} mm (floor of the grid {:.2} mm, at the truth {} mm)",
            number(summary.e_mm_mean),
            summary.e_floor_mm,
            number(summary.e_at_truth_mm_mean)
        ),
        format!(
            "cloud to surface           {} mm (both ways, visible nodes: {} mm)",
            number(summary.surface_mm_mean),
            number(summary.chamfer_mm_mean)
        ),
        format!(
            "true vertex error          mean {} mm, p95 {} mm, max {} mm",
            number(summary.vertex_error_mm_mean),
            number(summary.vertex_error_mm_p95),
            number(summary.vertex_error_mm_max)
        ),
        format!(
            "strain                     mean {} %, max {} %",
            number(summary.strain_percent_mean),
            number(summary.strain_percent_max)
        ),
    ];
    lines.extend(truth_lines(summary));
    lines.push(format!("passes through itself      in {} steps", summary.self_intersecting_steps));
    if let Some(order) = summary.layer_order_end.filter(|order| order.pairs > 0) {
        lines.push(format!(
            "layers at the end          {} of {} pairs in the wrong order",
            order.wrong, order.pairs
        ));
    }
    lines.extend(range_lines(summary));
    lines.push(format!(
        "time per step              p50 {} ms, p99 {} ms (segment {:.2}, register {:.2}, \
         simulate {:.2})",
        number(summary.ms_per_step_p50),
        number(summary.ms_per_step_p99),
        summary.ms_p50.segment,
        summary.ms_p50.register,
        summary.ms_p50.simulate
    ));
    lines.push(format!("states                     {}", summary.states_hash));
    lines.join("\n")
}

/// Two digits, or a dash.
fn number(value: Option<f64>) -> String {
    value.map_or("-".to_owned(), |v| format!("{v:.2}"))
}

/// What only the truth can tell.
fn truth_lines(summary: &Summary) -> Vec<String> {
    if summary.vertex_error_mm_mean.is_none() {
        return Vec::new();
    }
    vec![
        format!(
            "… of its shape alone       {} mm; as a whole off by ({}) mm",
            number(summary.shape_error_mm_mean),
            summary.offset_mm_mean.map(number).join(", "),
        ),
        format!(
            "… visible / hidden nodes    {} / {} mm; by layers on top 0, 1, 2, 3+: {} mm",
            number(summary.vertex_error_visible_mm_mean),
            number(summary.vertex_error_hidden_mm_mean),
            summary.vertex_error_by_layer_mm_mean.map(number).join(", "),
        ),
        format!(
            "creases                    angle off by {}°, place by {} mm; wrinkles {}°",
            number(summary.crease_angle_error_deg_mean),
            number(summary.crease_position_error_mm_mean),
            number(summary.wrinkle_deg_mean)
        ),
    ]
}

/// Figures with their range over the steps.
fn range_lines(summary: &Summary) -> Vec<String> {
    let ranges = [
        ("width (chord along u)      ", summary.width_m, 1e3, "mm"),
        ("length (chord along v)     ", summary.length_m, 1e3, "mm"),
        ("planarity of visible nodes ", summary.planarity_mm_rms, 1.0, "mm rms"),
        ("contour to tracked border  ", summary.outline_px_median, 1.0, "px median"),
    ];
    let line = |(name, range, scale, unit): (&str, Option<Range>, f64, &str)| {
        let [mean, min, max] = range.map(|r| [r.mean, r.min, r.max].map(|v| v * scale))?;
        Some(format!("{name}{mean:.2} {unit} ({min:.2} to {max:.2})"))
    };
    ranges.into_iter().filter_map(line).collect()
}
