//! Walking over the quads of a mesh from neighbour to neighbour.

use std::collections::HashMap;

use super::GridError;

/// The faces on both sides of an edge.
type EdgeFaces = HashMap<[u32; 2], Vec<usize>>;

/// Walks over quads from neighbour to neighbour.
pub(super) struct Walk<'a> {
    quads: &'a [[u32; 4]],
    faces_of: EdgeFaces,
}

impl<'a> Walk<'a> {
    pub fn new(quads: &'a [[u32; 4]]) -> Self {
        let mut faces_of = EdgeFaces::new();
        for (face, quad) in quads.iter().enumerate() {
            for k in 0..4 {
                faces_of.entry(edge(quad[k], quad[(k + 1) % 4])).or_default().push(face);
            }
        }
        Self { quads, faces_of }
    }

    /// Vertex numbers by row and column.
    pub fn order(&self, vertices: usize) -> Result<Vec<Vec<u32>>, GridError> {
        let mut uses = vec![0u32; vertices];
        self.quads.iter().flatten().for_each(|k| uses[*k as usize] += 1);
        let corner = uses.iter().position(|n| *n == 1).ok_or(GridError::NoCorner)? as u32;
        let quad = self.quads.iter().find(|quad| quad.contains(&corner));
        let quad = quad.ok_or(GridError::NoCorner)?;
        let at = quad.iter().position(|k| *k == corner).unwrap_or(0);
        // Along the winding lies i, against it j.
        let first = self.strip(corner, quad[(at + 3) % 4])?;
        let mut order = vec![first];
        let mut behind = None;
        loop {
            let low = &order[order.len() - 1];
            // The quad over the first edge of the line, on the side not yet walked.
            let Some(face) = self.across([low[0], low[1]], behind)? else { break };
            let mut next = vec![self.beside(face, low[0], low[1])];
            let mut last = face;
            for pair in low.windows(2) {
                let faces = self.faces_at(pair[0], pair[1]);
                let here =
                    faces.iter().copied().find(|f| self.quads[*f].contains(&next[next.len() - 1]));
                last = here.ok_or(GridError::NoRectangle { vertex: pair[1] })?;
                next.push(self.beside(last, pair[1], pair[0]));
            }
            // The line must end where the one below ended.
            let (end, end_low) = (next[next.len() - 1], low[low.len() - 1]);
            if self.across([end, end_low], Some(last))?.is_some() {
                return Err(GridError::NoRectangle { vertex: end });
            }
            behind = Some(face);
            order.push(next);
            if order.len() > vertices {
                return Err(GridError::NoRectangle { vertex: corner });
            }
        }
        self.check_whole(&order, vertices)?;
        Ok(order)
    }

    /// The vertices of a line on the mesh's rim, from `a` over `b` to the next corner.
    fn strip(&self, a: u32, b: u32) -> Result<Vec<u32>, GridError> {
        let mut line = vec![a, b];
        let [mut face] = self.faces_at(a, b)[..] else {
            return Err(GridError::NoRectangle { vertex: a });
        };
        loop {
            let [low, end] = [line[line.len() - 2], line[line.len() - 1]];
            // Over the quad's next side lies the next quad of the strip.
            let up = self.beside(face, end, low);
            let Some(next) = self.across([end, up], Some(face))? else { return Ok(line) };
            line.push(self.beside(next, end, up));
            face = next;
            if line.len() > self.quads.len() + 2 {
                return Err(GridError::NoRectangle { vertex: a });
            }
        }
    }

    /// The other neighbour of `vertex` in a quad that has the edge `vertex`–`partner`.
    fn beside(&self, face: usize, vertex: u32, partner: u32) -> u32 {
        let quad = self.quads[face];
        let at = quad.iter().position(|k| *k == vertex).unwrap_or(0);
        let (next, previous) = (quad[(at + 1) % 4], quad[(at + 3) % 4]);
        if next == partner { previous } else { next }
    }

    /// The quad on the other side of an edge than `behind`, if any.
    fn across(&self, [a, b]: [u32; 2], behind: Option<usize>) -> Result<Option<usize>, GridError> {
        let faces = self.faces_at(a, b);
        if faces.is_empty() || faces.len() > 2 {
            return Err(GridError::NoRectangle { vertex: a });
        }
        Ok(faces.iter().copied().find(|face| Some(*face) != behind))
    }

    /// The quads at an edge; none where it is an edge of no quad.
    fn faces_at(&self, a: u32, b: u32) -> &[usize] {
        self.faces_of.get(&edge(a, b)).map_or(&[], Vec::as_slice)
    }

    /// Every vertex once, and as many quads as cells.
    fn check_whole(&self, order: &[Vec<u32>], vertices: usize) -> Result<(), GridError> {
        let mut seen = vec![false; vertices];
        for k in order.iter().flatten() {
            if std::mem::replace(&mut seen[*k as usize], true) {
                return Err(GridError::NoRectangle { vertex: *k });
            }
        }
        let unseen = (0..vertices as u32)
            .find(|k| !seen[*k as usize] && self.quads.iter().any(|quad| quad.contains(k)));
        if let Some(vertex) = unseen {
            return Err(GridError::NoRectangle { vertex });
        }
        let cells = (order.len() - 1) * (order[0].len() - 1);
        if cells != self.quads.len() {
            return Err(GridError::NoRectangle { vertex: order[0][0] });
        }
        Ok(())
    }
}

/// An edge, whichever way it is walked.
fn edge(a: u32, b: u32) -> [u32; 2] {
    [a.min(b), a.max(b)]
}
