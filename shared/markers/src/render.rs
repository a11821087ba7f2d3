//! Markers as images, to print and to test with.

use crate::Dictionary;
use crate::grey::GreyImage;

/// An owned grey image, row-major.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Raster {
    /// Pixels of a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// 0 is black, 255 white.
    pub pixels: Vec<u8>,
}

impl Raster {
    /// The image to look at.
    pub fn view(&self) -> GreyImage<'_> {
        // `pixels` is public: a caller who resizes it gets an empty image, not a crash.
        GreyImage::new(self.width, self.height, &self.pixels).unwrap_or(GreyImage::EMPTY)
    }
}

impl Dictionary {
    /// A marker of `modules() · module_px` pixels a side, its border outermost: leave white of a
    /// module or more around it. `None` if the dictionary has no such marker.
    pub fn render(&self, id: u32, module_px: usize) -> Option<Raster> {
        if id >= self.len() {
            return None;
        }
        let side_px = self.modules() * module_px;
        let mut pixels = Vec::with_capacity(side_px * side_px);
        for y in 0..side_px {
            for x in 0..side_px {
                let black = self.is_black(id, y / module_px, x / module_px);
                pixels.push(if black { 0 } else { 255 });
            }
        }
        Some(Raster { width: side_px, height: side_px, pixels })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rendered_marker_has_its_modules() {
        let dictionary = Dictionary::predefined("DICT_5X5_50").unwrap();
        let image = dictionary.render(7, 3).unwrap();
        assert_eq!((image.width, image.height), (21, 21));
        for y in 0..21 {
            for x in 0..21 {
                let black = image.view().row(y)[x] == 0;
                assert_eq!(black, dictionary.is_black(7, y / 3, x / 3));
            }
        }
        assert_eq!(dictionary.render(50, 3), None);
        assert_eq!(Raster { width: 3, height: 3, pixels: vec![] }.view().width(), 0);
    }
}
