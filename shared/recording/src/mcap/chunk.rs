//! One chunk of a file, decompressed as it is read, its checksum checked at its end.

use std::borrow::Cow;
use std::io::Read;

use ::mcap::records::{Record, op};
use crc32fast::Hasher;

/// What is wrong with a chunk, phrased to follow the file's name.
pub(super) type Damage = Cow<'static, str>;

/// Bytes of a record's opcode and length.
pub(super) const RECORD_HEAD: usize = 9;
/// Bytes of a message record before the message itself.
const MESSAGE_HEAD: u64 = 22;
/// Bytes that are skipped at once.
const SKIP_BYTES: usize = 64 * 1024;

/// A chunk's records, front to back. Nothing of it may be believed before [`Self::finish`].
pub(super) struct ChunkReader<'a> {
    data: Data<'a>,
    crc: Hasher,
    crc_expected: u32,
    left: u64,
}

enum Data<'a> {
    Plain(&'a [u8]),
    Lz4(lz4::Decoder<&'a [u8]>),
}

/// A message's place in time, and how long it is.
#[derive(Debug, Clone, Copy)]
pub(super) struct MessageHead {
    pub(super) channel: u16,
    pub(super) sequence: u32,
    pub(super) time_ns: u64,
    /// Bytes that follow in the chunk; to be read or skipped by the caller.
    pub(super) bytes: u64,
}

/// What follows in a chunk.
#[derive(Debug, Clone, Copy)]
pub(super) enum Next {
    Message(MessageHead),
    /// Another record of this opcode and length, to be read or skipped by the caller.
    Other(u8, u64),
}

impl<'a> ChunkReader<'a> {
    /// Reads a chunk record's body.
    pub(super) fn new(body: &'a [u8]) -> Result<Self, Damage> {
        let record = ::mcap::parse_record(op::CHUNK, body);
        let Ok(Record::Chunk { header, data: Cow::Borrowed(data) }) = record else {
            return Err("a chunk's head is damaged".into());
        };
        let data = match header.compression.as_str() {
            "lz4" => Data::Lz4(lz4::Decoder::new(data).map_err(|error| error.to_string())?),
            "" => Data::Plain(data),
            other => {
                return Err(format!(
                    "a chunk is compressed by {other:?}, which is not supported; rewrite the \
                     file with `mcap compress --compression lz4`"
                )
                .into());
            }
        };
        Ok(Self {
            data,
            crc: Hasher::new(),
            crc_expected: header.uncompressed_crc,
            left: header.uncompressed_size,
        })
    }

    /// The next record's head.
    pub(super) fn next(&mut self) -> Result<Option<Next>, Damage> {
        if self.left == 0 {
            return Ok(None);
        }
        let mut head = [0; RECORD_HEAD];
        self.fill(&mut head)?;
        let [opcode, length @ ..] = head;
        let bytes = u64::from_le_bytes(length);
        if bytes > self.left || (opcode == op::MESSAGE && bytes < MESSAGE_HEAD) {
            return Err("a chunk's records are damaged".into());
        }
        if opcode != op::MESSAGE {
            return Ok(Some(Next::Other(opcode, bytes)));
        }
        let mut channel = [0; 2];
        let mut sequence = [0; 4];
        let mut times = [0; 16];
        self.fill(&mut channel)?;
        self.fill(&mut sequence)?;
        self.fill(&mut times)?;
        let [log_time, _publish_time] = bytemuck::cast::<_, [[u8; 8]; 2]>(times);
        Ok(Some(Next::Message(MessageHead {
            channel: u16::from_le_bytes(channel),
            sequence: u32::from_le_bytes(sequence),
            time_ns: u64::from_le_bytes(log_time),
            bytes: bytes - MESSAGE_HEAD,
        })))
    }

    /// Decompresses the next bytes into `out`.
    pub(super) fn fill(&mut self, out: &mut [u8]) -> Result<(), Damage> {
        self.left = self
            .left
            .checked_sub(out.len() as u64)
            .ok_or("a chunk's records are longer than the chunk")?;
        let read = match &mut self.data {
            Data::Plain(data) => data.read_exact(out),
            Data::Lz4(decoder) => decoder.read_exact(out),
        };
        read.map_err(|error| format!("a chunk cannot be decompressed ({error})"))?;
        self.crc.update(out);
        Ok(())
    }

    /// Decompresses the next `bytes` bytes into `out`, which is cleared first.
    pub(super) fn fill_vec(&mut self, bytes: u64, out: &mut Vec<u8>) -> Result<(), Damage> {
        if bytes > self.left {
            return Err("a chunk's records are longer than the chunk".into());
        }
        out.clear();
        let mut left = bytes as usize;
        // In pieces: a damaged length must not make room that nothing will fill.
        while left > 0 {
            let start = out.len();
            out.resize(start + left.min(1 << 20), 0);
            self.fill(&mut out[start..])?;
            left = left.saturating_sub(1 << 20);
        }
        Ok(())
    }

    /// Passes over the next `bytes` bytes, which count for the checksum.
    pub(super) fn skip(&mut self, mut bytes: u64) -> Result<(), Damage> {
        let mut scratch = [0; SKIP_BYTES];
        while bytes > 0 {
            let length = bytes.min(SKIP_BYTES as u64);
            self.fill(&mut scratch[..length as usize])?;
            bytes -= length;
        }
        Ok(())
    }

    /// Reads the rest and compares the checksum. A chunk without one is damaged: every chunk that
    /// Orime writes has one.
    pub(super) fn finish(mut self) -> Result<(), Damage> {
        self.skip(self.left)?;
        let found = self.crc.finalize();
        if found != self.crc_expected {
            let expected = self.crc_expected;
            return Err(
                format!("a chunk's checksum is {found:08x} instead of {expected:08x}").into()
            );
        }
        Ok(())
    }
}
