//! Which recorded or rendered frame a step shows, and when.

/// What follows the last frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum After {
    /// Nothing: the source ends.
    End,
    /// The first frame again.
    StartOver,
    /// The same frames backwards, then forwards again.
    TurnBack,
}

/// Maps steps to frames.
#[derive(Debug, Clone, Copy)]
pub struct Playback {
    /// Number of frames, at least 1.
    pub frames: u64,
    /// What follows the last frame.
    pub after: After,
}

impl Playback {
    /// Number of steps, or `None` for an endless source.
    pub fn steps(&self) -> Option<u64> {
        (self.after == After::End).then_some(self.frames)
    }

    /// The frame that `step` shows. Past the end of a source that ends: the last one.
    pub fn frame(&self, step: u64) -> u64 {
        let n = self.frames;
        match self.after {
            After::End => step.min(n - 1),
            After::StartOver => step % n,
            After::TurnBack => {
                let k = step % (2 * n);
                if k < n { k } else { 2 * n - 1 - k }
            }
        }
    }

    /// How often the frames have been played through before `step`.
    pub fn round(&self, step: u64) -> u64 {
        match self.after {
            After::End => 0,
            After::StartOver | After::TurnBack => step / self.frames,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_of_seven_steps() {
        for (after, expected) in [
            (After::End, [0, 1, 2, 2, 2, 2, 2]),
            (After::StartOver, [0, 1, 2, 0, 1, 2, 0]),
            (After::TurnBack, [0, 1, 2, 2, 1, 0, 0]),
        ] {
            let playback = Playback { frames: 3, after };
            let frames: Vec<u64> = (0..7).map(|step| playback.frame(step)).collect();
            assert_eq!(frames, expected, "{after:?}");
        }
    }
}
