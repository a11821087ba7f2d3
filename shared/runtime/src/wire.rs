//! Lets our messages through iceoryx2's type check, under the names of their layouts.

use std::fmt;

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;
use orime_messages::{FRAME_ALIGNMENT, Message};

/// A message as iceoryx2 sees it.
#[repr(transparent)]
#[derive(Clone, Copy)]
pub(crate) struct Wire<M: Message>(pub(crate) M);

// SAFETY: `M` is `Pod`: no pointers, no padding, one representation in every process; `Wire` is
// transparent over it. The name holds a hash of the layout, so equal names mean equal layouts.
unsafe impl<M: Message> ZeroCopySend for Wire<M> {
    unsafe fn type_name() -> &'static str {
        M::TYPE_NAME
    }
}

/// The unit that frames' payloads are made of; it brings their alignment.
///
/// Not `[u8]` with an alignment of its own: iceoryx2 0.10 then reserves that many bytes for every
/// single one, 64 times the memory.
#[repr(C, align(64))]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct Block([u8; FRAME_ALIGNMENT]);

const _: () = assert!(align_of::<Block>() == FRAME_ALIGNMENT);

impl Block {
    /// Blocks that hold so many bytes; never none.
    pub(crate) fn count(bytes: usize) -> usize {
        bytes.div_ceil(FRAME_ALIGNMENT).max(1)
    }
}

// SAFETY: `Block` is `Pod`: bytes, without padding, with one representation in every process.
unsafe impl ZeroCopySend for Block {
    unsafe fn type_name() -> &'static str {
        "orime.FrameBlock.v1"
    }
}

impl<M: Message> Default for Wire<M> {
    fn default() -> Self {
        Self(M::zeroed())
    }
}

impl<M: Message> fmt::Debug for Wire<M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(M::TYPE_NAME)
    }
}
