//! Lets our messages through iceoryx2's type check, under the names of their layouts.

use std::fmt;

use iceoryx2::prelude::ZeroCopySend;
use orime_messages::Message;

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
