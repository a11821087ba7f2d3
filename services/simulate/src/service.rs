//! simulate as a process: advances the sheet by each set of targets and publishes its state.

use orime_geometry::{SheetGrid, SheetParams};
use orime_messages::{SheetState, Targets};
use orime_runtime::{
    Pace, Publisher, Received, Recorder, Service, Subscription, Work, channel, now_ns,
};
use orime_simulate::{SimulateParams, Simulator, frame_s};

/// The simulate process.
pub struct Simulate {
    simulator: Simulator,
    sheet: SheetGrid,
    pace: Pace,
    targets: Subscription<Targets>,
    states: Publisher<SheetState>,
    recorder: Recorder,
    exposure_before_ns: Option<u64>,
    has_pose: bool,
}

impl Simulate {
    /// Opens this stage's channels and says that it is ready.
    pub fn open(service: &Service) -> anyhow::Result<Self> {
        let config = service.config("simulate", SimulateParams::check)?;
        let params: SheetParams = service.section("sheet")?;
        let sheet = service.config("sheet", SheetParams::check)?;
        let rest_m = orime_recording::template::load(&params, &sheet)?;
        let density = params.density_kg_per_m2;
        let mut simulator = Simulator::new(&config, &sheet, density, rest_m.as_deref());
        choose_backend(&mut simulator)?;
        let simulate = Self {
            simulator,
            pace: service.set().pace,
            targets: service.subscribe(&channel::TARGETS)?,
            states: service.publish(&channel::STATE)?,
            recorder: service.recorder()?,
            exposure_before_ns: None,
            has_pose: false,
            sheet,
        };
        service.ready()?;
        Ok(simulate)
    }

    /// Advances the sheet until the stream of targets ends.
    pub fn run(mut self) -> anyhow::Result<()> {
        while let Some(targets) = self.next_targets()? {
            if targets.header.is_end() {
                self.states.send_end(&targets.header)?;
                self.recorder.ended(&targets.header, self.targets.drops())?;
                break;
            }
            if !self.publish_state(&targets)? {
                break;
            }
        }
        Ok(())
    }

    fn next_targets(&mut self) -> anyhow::Result<Option<Received<Targets>>> {
        Ok(match self.pace {
            Pace::Lockstep => self.targets.next()?,
            Pace::Realtime => self.targets.newest()?,
        })
    }

    /// Publishes the state after one set of targets; `false` if asked to stop while waiting.
    fn publish_state(&mut self, targets: &Received<Targets>) -> anyhow::Result<bool> {
        let dt_s = frame_s(self.exposure_before_ns, targets.header.exposure_ns);
        self.exposure_before_ns = Some(targets.header.exposure_ns);
        let reset = targets.figures.reset != 0;
        self.has_pose |= reset;
        let (simulator, sheet, has_pose) = (&mut self.simulator, &self.sheet, self.has_pose);
        let mut work = Work {
            upstream_publish_ns: targets.header.publish_ns,
            take_ns: targets.take_ns,
            status: targets.figures.tracking,
            bytes: (sheet.len() * 12) as u64,
            ..Work::default()
        };
        let sent = self.states.send_with(&targets.header, |state| {
            work.start_ns = now_ns();
            state.targets_rejected = 0;
            // Before the first pose there is nothing to simulate, but the loop goes on.
            if has_pose {
                let (targets_m, confidence) = (targets.targets_m(), targets.confidence());
                let report = simulator.step(dt_s, targets_m, confidence, reset);
                state.targets_rejected = report.targets_rejected;
            }
            state.figures = targets.figures;
            state.n_nodes = sheet.len() as u32;
            state.has_pose = u32::from(has_pose);
            state.nodes = sheet.nodes.map(|nodes| nodes as u32);
            state.size_m = sheet.size_m;
            state.positions_m[..sheet.len()].copy_from_slice(simulator.positions_m());
            work.end_ns = now_ns();
        })?;
        let Some(sent) = sent else { return Ok(false) };
        self.recorder.published(&sent.header, work, self.targets.drops())?;
        Ok(true)
    }
}

/// Decides where the substeps run, and says so unless the scene asks for the CPU.
#[cfg(feature = "gpu")]
fn choose_backend(simulator: &mut Simulator) -> anyhow::Result<()> {
    let start = std::time::Instant::now();
    let chosen = simulator.choose_backend(&mut || start.elapsed().as_secs_f64())?;
    let [cpu_us, gpu_us] = chosen.frame_s.map(|seconds| seconds * 1e6);
    match (&chosen.adapter, &chosen.refused) {
        (Some(adapter), _) => tracing::info!(adapter, cpu_us, gpu_us, "simulates on the GPU"),
        (None, Some(why)) => tracing::info!(why, "simulates on the CPU"),
        (None, None) if cpu_us.is_finite() => {
            tracing::info!(cpu_us, gpu_us, "simulates on the CPU");
        }
        (None, None) => {}
    }
    Ok(())
}

/// Without the feature there is only the CPU.
#[cfg(not(feature = "gpu"))]
fn choose_backend(simulator: &mut Simulator) -> anyhow::Result<()> {
    anyhow::ensure!(
        !simulator.wants_gpu(),
        "`simulate.backend` is \"gpu\", but this program was built without the feature `gpu`"
    );
    Ok(())
}
