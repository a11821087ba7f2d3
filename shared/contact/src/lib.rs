//! Self-contact: layers of a folded sheet never pass through each other.
//!
//! A folded sheet is a few stiff facets whose layer order is known ([`orime_creases::Folds`]), so
//! most contacts are a few ordered pairs of facets: [`FacetContact`].
//!
//! ```text
//! project(x), up to `rounds` times:
//!   rigid fit per facet -> centre, (u, v) axes, normal n                      (pose)
//!   pairs of facets that can touch; nodes of f over g                         (near, overlap)
//!   sign per pair: Folds::order; where nothing overlaps, the sign of a
//!     neighbour across a flat crease that does                                (order)
//!   node–triangle, edge–edge along the facet's normal; creases that nest or
//!     meet back to back                                  (node_triangle, edge_edge, spine)
//!   `sweeps` × (links, contacts), then 3 × contacts, the last write           (project)
//!   until no contact is below half its gap
//! gap = clip(slope·r, gap_min, thickness), r = distance to a corner or crease of both facets and
//!   to any of their creases that is folded past 90°
//! ```
//!
//! What is not folded flat, and the last write to the positions, is [`GenericContact`]'s: it knows
//! no facets, only nodes and triangles, edges and edges.
//!
//! Source: `../shared/design/contact.md`. Deviations: any facets, creases off the grid lines (the
//! triangles that a crease cuts belong to both sides, their chords may shorten), nothing is done
//! where nothing is near.

mod candidates;
mod edge_edge;
mod frames;
mod gap;
mod generic;
mod links;
mod mesh;
mod near;
mod node_triangle;
mod order;
mod params;
mod pose;
mod project;
mod push;
mod runs;
mod self_contact;
mod spine;
mod topology;

pub use generic::{GenericContact, GenericReport, NetReport, UntangleReport};
pub use params::{ContactConfig, ContactParams};
pub use project::{ContactReport, FacetContact};
pub use self_contact::{PassReport, SelfContact};
