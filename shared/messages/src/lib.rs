//! What travels between the processes: `repr(C)` layouts and their hashes.
//!
//! A message is its layout: plain old data without padding, its name ending in a hash over all
//! its fields, so that two programs that disagree never talk to each other.

mod cloud;
mod folds;
mod frame;
mod gripper;
mod header;
pub mod layout;
mod plan;
mod record;
mod sheet;

use bytemuck::Pod;

pub use cloud::{EDGELS_MAX, FEATURES_MAX, ObservedCloud, POINTS_MAX};
pub use folds::{CORNERS_MAX, CREASES_MAX, CreaseMeta, FoldsMeta};
pub use frame::{
    CAMERA_NAME_MAX, CAMERAS_MAX, CameraMeta, FRAME_ALIGNMENT, FrameExtent, FrameMeta, FrameStatus,
    LensMeta, PoseMeta,
};
pub use gripper::{GRIPPERS_MAX, GripperMeta, Grippers};
pub use header::{ClockDomain, FLAG_END, FLAG_PREDICTION, Header, Stage};
pub use plan::{FoldPlan, PLAN_LINES_MAX, PlanLineMeta};
pub use record::{Drops, EFFECTS, RecordKind, StageRecord, WHOLE_SET};
pub use sheet::{RegisterFigures, SheetState, Targets, Truth};

const LAYOUTS: u64 = {
    let hash = layout::named("orime");
    let hash = layout::mix_u64(hash, <FrameMeta as layout::Layout>::HASH);
    let hash = layout::mix_u64(hash, <ObservedCloud as layout::Layout>::HASH);
    let hash = layout::mix_u64(hash, <Targets as layout::Layout>::HASH);
    let hash = layout::mix_u64(hash, <SheetState as layout::Layout>::HASH);
    let hash = layout::mix_u64(hash, <Truth as layout::Layout>::HASH);
    let hash = layout::mix_u64(hash, <Grippers as layout::Layout>::HASH);
    let hash = layout::mix_u64(hash, <FoldPlan as layout::Layout>::HASH);
    layout::mix_u64(hash, <StageRecord as layout::Layout>::HASH)
};

/// Version and layouts of all messages: `orime-VERSION.HASH`. Processes that do not agree in it
/// refuse each other before they open a channel.
pub const PROTOCOL: &str = {
    const BASE: &str = concat!("orime-", env!("CARGO_PKG_VERSION"));
    const BYTES: [u8; BASE.len() + 1 + layout::HASH_DIGITS] = layout::type_name(BASE, LAYOUTS);
    match core::str::from_utf8(&BYTES) {
        Ok(text) => text,
        Err(_) => panic!("versions are ASCII"),
    }
};

/// Plain old data that begins with a [`Header`] and is named after its layout.
pub trait Message: Pod + layout::Layout {
    /// `orime.<Type>.v<N>.<layout hash>`.
    const TYPE_NAME: &'static str;

    /// The message's header.
    fn header(&self) -> &Header;

    /// The message's header, to be written.
    fn header_mut(&mut self) -> &mut Header;
}

#[cfg(test)]
mod tests {
    use super::*;

    mod as_it_is {
        use crate::Header;
        crate::message! {
            /// A message.
            pub struct Sample as "orime.Sample.v1" {
                /// Header.
                pub header: Header,
                /// A field.
                pub width: u32,
                /// Another of the same size.
                pub height: u32,
            }
        }
    }

    mod permuted {
        use crate::Header;
        crate::message! {
            /// The same message with two fields of one size and type permuted.
            pub struct Sample as "orime.Sample.v1" {
                /// Header.
                pub header: Header,
                /// Another of the same size.
                pub height: u32,
                /// A field.
                pub width: u32,
            }
        }
    }

    mod retyped {
        use crate::Header;
        crate::message! {
            /// The same message with a field of another type of the same size.
            pub struct Sample as "orime.Sample.v1" {
                /// Header.
                pub header: Header,
                /// A field.
                pub width: u32,
                /// Another of the same size.
                pub height: f32,
            }
        }
    }

    #[test]
    fn permuting_or_retyping_fields_changes_the_name() {
        let name = as_it_is::Sample::TYPE_NAME;
        assert!(name.starts_with("orime.Sample.v1.") && name.len() == 16 + 16, "{name}");
        assert_eq!(size_of::<as_it_is::Sample>(), size_of::<permuted::Sample>());
        assert_ne!(name, permuted::Sample::TYPE_NAME);
        assert_ne!(name, retyped::Sample::TYPE_NAME);
    }

    #[test]
    fn a_change_deep_inside_changes_the_name() {
        assert_ne!(
            <[[f32; 3]; 4] as layout::Layout>::HASH,
            <[[f32; 4]; 3] as layout::Layout>::HASH,
        );
        assert_ne!(<[u32; 2] as layout::Layout>::HASH, <[f32; 2] as layout::Layout>::HASH);
    }

    #[test]
    fn messages_have_names_of_their_own() {
        let names = [
            FrameMeta::TYPE_NAME,
            ObservedCloud::TYPE_NAME,
            Targets::TYPE_NAME,
            SheetState::TYPE_NAME,
            Truth::TYPE_NAME,
            Grippers::TYPE_NAME,
            FoldPlan::TYPE_NAME,
            StageRecord::TYPE_NAME,
        ];
        for (k, name) in names.iter().enumerate() {
            assert!(name.is_ascii() && name.len() < 128, "{name}");
            assert!(!names[..k].contains(name), "{name} is there twice");
        }
    }
}
