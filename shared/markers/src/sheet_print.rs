//! A sheet that carries markers on both sides, with ids of their own.

use orime_params::Problem;

use crate::{Dictionary, SheetLayout, SheetMarker, SheetSide};

/// The smallest of these that has enough markers is printed; each begins with the one before.
const DICTIONARIES: [&str; 3] = ["DICT_4X4_100", "DICT_4X4_250", "DICT_4X4_1000"];

/// What Orime prints on a sheet: markers 0, 1 … on its front, and on from there on its back.
///
/// 25 × 25 nodes: DICT_4X4_100, 0 to 48 on the front and 49 to 97 on the back.
#[derive(Debug, Clone, PartialEq)]
pub struct SheetPrint {
    dictionary: Dictionary,
    sides: [SheetLayout; 2],
}

impl SheetPrint {
    /// The print for a sheet of `nodes` nodes along u and v. The problem, if there is one, is about
    /// the key `nodes`.
    pub fn new(nodes: [usize; 2]) -> Result<Self, Problem> {
        let mut refused = None;
        for name in DICTIONARIES {
            let dictionary = Dictionary::predefined(name)
                .map_err(|error| Problem { key: "nodes".to_owned(), message: error.to_string() })?;
            let front = SheetLayout::new(&dictionary, nodes, SheetSide::Front, 0);
            let back = front.and_then(|front| {
                let first_id = front.markers().len() as u32;
                let back = SheetLayout::new(&dictionary, nodes, SheetSide::Back, first_id)?;
                Ok([front, back])
            });
            match back {
                Ok(sides) => return Ok(Self { dictionary, sides }),
                Err(problem) if problem.key == "nodes" => return Err(problem),
                Err(problem) => refused = Some(problem.message),
            }
        }
        let message = format!(
            "is {nodes:?}: too many for a printed sheet, whose dictionary {}; use fewer",
            refused.unwrap_or_default()
        );
        Err(Problem { key: "nodes".to_owned(), message })
    }

    /// The dictionary of both sides.
    pub fn dictionary(&self) -> &Dictionary {
        &self.dictionary
    }

    /// What is on one side.
    pub fn side(&self, side: SheetSide) -> &SheetLayout {
        match side {
            SheetSide::Front => &self.sides[0],
            SheetSide::Back => &self.sides[1],
        }
    }

    /// The marker of this id, on whichever side.
    pub fn marker(&self, id: u32) -> Option<&SheetMarker> {
        self.sides.iter().find_map(|side| side.marker(id))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_sides_have_ids_of_their_own() {
        let print = SheetPrint::new([25, 25]).unwrap();
        assert_eq!(print.dictionary().len(), 100);
        let ids: Vec<u32> = [SheetSide::Front, SheetSide::Back]
            .into_iter()
            .flat_map(|side| print.side(side).markers().iter().map(|marker| marker.id))
            .collect();
        assert_eq!(ids, (0..98).collect::<Vec<u32>>());
        assert_eq!(print.marker(49), print.side(SheetSide::Back).marker(49));
        assert_eq!(print.marker(98), None);
        assert_eq!(SheetPrint::new([25, 35]).unwrap().dictionary().len(), 250);
        assert_eq!(SheetPrint::new([24, 25]).unwrap_err().key, "nodes");
    }
}
