//! Shared memory: how much a set needs, whether it is there, and holding on to it.

use std::fs::OpenOptions;
use std::io;
use std::os::unix::fs::MetadataExt;

use orime_messages::{
    FoldPlan, Grippers, Message, ObservedCloud, SheetState, Stage, StageRecord, Targets, Truth,
};
use rustix::fs::{FallocateFlags, fallocate, statvfs};

use crate::channel::{self, Channel, Pace};
use crate::run::{RunId, SHARED_MEMORY_DIR, shared_memory_of};

/// iceoryx2's headers of one message and the rounding to its alignment, at most, bytes.
const CHUNK_OVERHEAD: usize = 512;
/// Unit of a file's `blocks`, bytes.
const BLOCK_BYTES: u64 = 512;
/// Management segments, connections and events of a whole set, at most, bytes.
const MANAGEMENT_BYTES: u64 = 6 << 20;

/// Shared memory that a set needs, bytes. `frame_bytes`: the largest camera's frame payload.
pub fn needed_bytes(pace: Pace, cameras: usize, frame_bytes: usize) -> u64 {
    fn pool<M: Message>(channel: &Channel<M>, pace: Pace, cameras: usize, bytes: usize) -> u64 {
        channel.pool(pace, cameras) as u64 * (bytes + CHUNK_OVERHEAD).next_multiple_of(64) as u64
    }
    let records = Stage::PIPELINE.len() as u64;
    pool(&channel::FRAME, pace, cameras, frame_bytes)
        + pool(&channel::CLOUD, pace, cameras, size_of::<ObservedCloud>())
        + pool(&channel::TARGETS, pace, cameras, size_of::<Targets>())
        + pool(&channel::STATE, pace, cameras, size_of::<SheetState>())
        + pool(&channel::TRUTH, pace, cameras, size_of::<Truth>())
        + pool(&channel::GRIPPER, pace, cameras, size_of::<Grippers>())
        + pool(&channel::PLAN, pace, cameras, size_of::<FoldPlan>())
        + pool(&channel::PREDICTION, pace, cameras, size_of::<SheetState>())
        + records * pool(&channel::RECORD, pace, cameras, size_of::<StageRecord>())
        + MANAGEMENT_BYTES
}

/// Free shared memory on this machine, bytes.
pub fn free_bytes() -> io::Result<u64> {
    let status = statvfs(SHARED_MEMORY_DIR)?;
    Ok(status.f_bavail * status.f_frsize)
}

/// Makes sure that every page of this run's shared memory exists.
///
/// iceoryx2 only sets the size of its files; on a full `/dev/shm` the first write to a page
/// would then kill the writer with SIGBUS. Here it is an error instead.
pub(crate) fn reserve(run: RunId) -> io::Result<()> {
    for path in shared_memory_of(run)? {
        let file = match OpenOptions::new().read(true).write(true).open(&path) {
            Ok(file) => file,
            // Another process of the run removed its own, or is still preparing it.
            Err(error) if is_not_ours(&error) => continue,
            Err(error) => return Err(error),
        };
        let meta = file.metadata()?;
        let bytes = meta.len();
        // What others have reserved is not gone through again: a restarted stage is in a hurry.
        if meta.blocks() * BLOCK_BYTES < bytes {
            fallocate(&file, FallocateFlags::empty(), 0, bytes)?;
        }
    }
    Ok(())
}

fn is_not_ours(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::PermissionDenied)
}
