//! What a damaged recording has lost.

use std::fmt;

/// What could not be recovered from a file. Everything else reads bit for bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Loss {
    /// Bytes that belong to damaged or incomplete chunks, or follow the first unreadable record.
    pub bytes: u64,
    /// Whole chunks whose checksum or content is wrong.
    pub chunks: u64,
    /// Messages lost; `None` where nobody knows, because the file's own count is lost as well.
    pub messages: Option<u64>,
    /// Frames (one camera at one step) of the steps that are left.
    pub frames: u64,
    /// Whether the file has no end: it was cut off, or the recorder never finished it.
    pub end_missing: bool,
    /// Whether bytes outside the chunks are damaged, such as the index or the description;
    /// frames, clouds and sheets do not depend on them.
    pub outside_chunks: bool,
}

impl Loss {
    /// Whether the file is whole.
    pub fn is_none(&self) -> bool {
        *self == Self { messages: Some(0), ..Self::default() }
    }

    /// Whether the file is damaged. Frames that are missing from a whole file were never
    /// recorded, because they were unreadable or came too fast: that is no damage.
    pub fn is_damage(&self) -> bool {
        !Self { frames: 0, ..*self }.is_none()
    }
}

impl fmt::Display for Loss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_none() {
            return write!(f, "nothing is lost");
        }
        let Self { bytes, chunks, messages, frames, end_missing, outside_chunks } = *self;
        write!(f, "{bytes} bytes are lost")?;
        match messages {
            Some(messages) => write!(f, ", {messages} messages")?,
            None => write!(f, ", an unknown number of messages")?,
        }
        write!(f, ", {frames} frames of the remaining steps")?;
        if chunks > 0 {
            write!(f, "; {chunks} chunks are damaged")?;
        }
        if end_missing {
            write!(f, "; the file's end is missing")?;
        }
        if outside_chunks {
            write!(f, "; bytes outside the chunks are damaged")?;
        }
        Ok(())
    }
}
