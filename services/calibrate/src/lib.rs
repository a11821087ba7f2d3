//! Where cameras stand and how their depth errs, found from markers that several of them see.
//!
//! [`observe`] reads frame sets and finds markers, [`border_shift`] says how far an image moves
//! their sides, [`start`] chains them to a first guess, [`fit`] adjusts everything at once
//! ([`bundle`] has the equations), [`agreement`] scores fits on frame sets that they have not seen.

pub mod agreement;
pub mod border_shift;
pub mod bundle;
pub mod command;
pub mod fit;
pub mod observe;
pub mod pictures;
pub mod report;
mod residuals;
pub mod square;
pub mod start;
mod unknowns;
