//! What the kernels of a scene are made of.

/// A part of the kernels that a scene may do without. Of what no sheet needs nothing is compiled,
/// no buffer is made and no pass runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Piece {
    /// Targets pull.
    Track,
    /// Grippers hold points.
    Grippers,
    /// The sheet bends as a plate.
    Plate,
    /// XPBD's damping.
    Xpbd,
    /// The paper's damping.
    Paper,
    /// Links yield.
    Plastic,
    /// Poses of facets are looked for: what [`Piece::Crease`] and [`Piece::Facets`] share.
    Fit,
    /// Hinges turn.
    Crease,
    /// Facets are stiff.
    Facets,
    /// There is a table.
    Table,
}

/// A set of pieces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Pieces(u16);

impl Piece {
    /// All, and in the kernels' text each after what it uses.
    const ALL: [Self; 10] = [
        Self::Track,
        Self::Grippers,
        Self::Plate,
        Self::Xpbd,
        Self::Paper,
        Self::Plastic,
        Self::Fit,
        Self::Crease,
        Self::Facets,
        Self::Table,
    ];

    /// Its name in the kernels, after `// if `; and its text, where it is more than such lines.
    fn name_and_text(self) -> (&'static str, &'static str) {
        match self {
            Self::Track => ("track", include_str!("track.wgsl")),
            Self::Grippers => ("grippers", include_str!("grippers.wgsl")),
            Self::Plate => ("plate", include_str!("plate.wgsl")),
            Self::Xpbd => ("xpbd", ""),
            Self::Paper => ("paper", ""),
            Self::Plastic => ("plastic", include_str!("plastic.wgsl")),
            Self::Fit => ("fit", include_str!("fit.wgsl")),
            Self::Crease => ("crease", include_str!("crease.wgsl")),
            Self::Facets => ("facets", include_str!("facets.wgsl")),
            Self::Table => ("table", include_str!("table.wgsl")),
        }
    }
}

impl Pieces {
    /// Adds a piece.
    pub fn insert(&mut self, piece: Piece) {
        self.0 |= 1 << piece as u16;
    }

    /// Takes a piece out.
    #[cfg(test)]
    pub fn remove(&mut self, piece: Piece) {
        self.0 &= !(1 << piece as u16);
    }

    /// Whether a piece is in it.
    pub fn contains(self, piece: Piece) -> bool {
        self.0 >> piece as u16 & 1 == 1
    }

    /// The text of the kernels: what all share, the pieces, and a path's entries; lines that end
    /// in `// if NAME` only where that piece is in it.
    pub fn kernels(self) -> String {
        let mut text = String::new();
        let there = Piece::ALL.into_iter().filter(|piece| self.contains(*piece));
        let texts = [include_str!("passes.wgsl"), include_str!("sheet.wgsl")];
        let texts = texts.into_iter().chain([include_str!("passes_apart.wgsl")]);
        for source in texts.chain(there.map(|piece| piece.name_and_text().1)) {
            for line in source.lines().filter(|line| self.keeps(line)) {
                text.push_str(line);
                text.push('\n');
            }
        }
        text
    }

    fn keeps(self, line: &str) -> bool {
        let Some((_, name)) = line.split_once(" // if ") else { return true };
        Piece::ALL.into_iter().any(|piece| piece.name_and_text().0 == name && self.contains(piece))
    }
}

impl FromIterator<Piece> for Pieces {
    fn from_iter<I: IntoIterator<Item = Piece>>(pieces: I) -> Self {
        let mut all = Self::default();
        pieces.into_iter().for_each(|piece| all.insert(piece));
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_condition_in_the_kernels_names_a_piece() {
        let names = Piece::ALL.map(|piece| piece.name_and_text().0);
        let texts = Piece::ALL.map(|piece| piece.name_and_text().1);
        let own = [include_str!("passes.wgsl"), include_str!("sheet.wgsl")];
        let own = own.into_iter().chain([include_str!("passes_apart.wgsl")]);
        let lines = own.chain(texts).flat_map(str::lines);
        let named: Vec<_> = lines.filter_map(|line| line.split_once(" // if ")).collect();
        assert!(named.len() > 9 && named.iter().all(|(_, name)| names.contains(name)), "{named:?}");
    }

    #[test]
    fn what_is_not_needed_is_not_in_the_text() {
        let bare = Pieces::default().kernels();
        for word in ["hinges:", "anchors:", "stencils:", "rests_m", "facets:", "targets:", "way_a,"]
        {
            assert!(!bare.contains(&format!("> {word}")), "{word}");
            assert!(!bare.contains("rest_on_table"));
        }
        let creased: Pieces = [Piece::Fit, Piece::Crease].into_iter().collect();
        assert!(creased.kernels().contains("fn turn_hinges"));
        assert!(!creased.kernels().contains("fn hold_facet"));
    }
}
