//! Connected components of a binary image by run-length union-find.

use crate::bits::BitImage;

/// A horizontal run of equal pixels, `start..end` in row `y`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Run {
    pub y: u32,
    pub start: u32,
    pub end: u32,
    /// Number of the component, counted in raster order of its first pixel.
    pub component: u32,
}

impl Run {
    pub fn len(&self) -> u32 {
        self.end - self.start
    }
}

/// What is known of one component.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Component {
    pub pixels: u32,
    /// Whether it has a pixel in the image's outermost rows or columns.
    pub at_border: bool,
}

/// 4-connected components, in raster order.
#[derive(Debug)]
pub(crate) struct Components {
    pub runs: Vec<Run>,
    pub list: Vec<Component>,
    /// Runs of row `y` are `row_start[y]..row_start[y + 1]`.
    row_start: Vec<u32>,
    parent: Vec<u32>,
}

impl Components {
    /// Memory for any image of this size.
    pub fn new(width: usize, height: usize) -> Self {
        let runs_max = width.div_ceil(2) * height;
        Self {
            runs: Vec::with_capacity(runs_max),
            list: Vec::with_capacity(runs_max),
            row_start: Vec::with_capacity(height + 1),
            parent: Vec::with_capacity(runs_max),
        }
    }

    /// Finds the components of the pixels that equal `value`.
    pub fn find(&mut self, image: &BitImage, value: bool) {
        self.runs.clear();
        self.row_start.clear();
        self.parent.clear();
        let flip = if value { 0 } else { !0 };
        for y in 0..image.height {
            self.row_start.push(self.runs.len() as u32);
            self.scan_row(image, y, flip);
            self.join_rows(y);
        }
        self.row_start.push(self.runs.len() as u32);
        self.number(image);
    }

    /// The component at a pixel, if it belongs to one.
    pub fn at(&self, x: usize, y: usize) -> Option<usize> {
        let range = self.row_start[y] as usize..self.row_start[y + 1] as usize;
        let row = &self.runs[range];
        let after = row.partition_point(|run| run.start as usize <= x);
        let run = row[..after].last()?;
        ((run.end as usize) > x).then_some(run.component as usize)
    }

    fn scan_row(&mut self, image: &BitImage, y: usize, flip: u64) {
        let row = image.row(y);
        let mut open: Option<u32> = None;
        for (k, word) in row.iter().enumerate() {
            let word = (word ^ flip) & image.used(k);
            // Bit i of `changes`: pixel i differs from its left neighbour.
            let mut changes = word ^ (word << 1 | u64::from(open.is_some()));
            while changes != 0 {
                let x = (64 * k) as u32 + changes.trailing_zeros();
                changes &= changes - 1;
                match open.take() {
                    Some(start) => self.push(y, start, x),
                    None => open = Some(x),
                }
            }
        }
        if let Some(start) = open {
            self.push(y, start, image.width as u32);
        }
    }

    fn push(&mut self, y: usize, start: u32, end: u32) {
        // In a partly used last word the change after the last pixel lies within the word.
        self.parent.push(self.runs.len() as u32);
        self.runs.push(Run { y: y as u32, start, end, component: 0 });
    }

    fn join_rows(&mut self, y: usize) {
        if y == 0 {
            return;
        }
        let mut above = self.row_start[y - 1] as usize;
        let here = self.row_start[y] as usize;
        for k in here..self.runs.len() {
            while above < here && self.runs[above].end <= self.runs[k].start {
                above += 1;
            }
            let mut j = above;
            while j < here && self.runs[j].start < self.runs[k].end {
                let (a, b) = (self.root(j as u32), self.root(k as u32));
                self.parent[a.max(b) as usize] = a.min(b);
                j += 1;
            }
        }
    }

    fn root(&mut self, mut k: u32) -> u32 {
        while self.parent[k as usize] != k {
            self.parent[k as usize] = self.parent[self.parent[k as usize] as usize];
            k = self.parent[k as usize];
        }
        k
    }

    fn number(&mut self, image: &BitImage) {
        self.list.clear();
        for k in 0..self.runs.len() {
            let root = self.root(k as u32) as usize;
            if root == k {
                self.runs[k].component = self.list.len() as u32;
                self.list.push(Component { pixels: 0, at_border: false });
            }
            let component = self.runs[root].component;
            let run = &mut self.runs[k];
            run.component = component;
            let component = &mut self.list[component as usize];
            component.pixels += run.len();
            component.at_border |= run.y == 0
                || run.y as usize == image.height - 1
                || run.start == 0
                || run.end as usize == image.width;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bits::picture::parse;

    #[test]
    fn a_ring_is_one_component_and_its_hole_another() {
        let mut components = Components::new(7, 5);
        let image = parse(
            ".......
             .####..
             .#..#.#
             .####..
             .......",
        );
        components.find(&image, true);
        let found: Vec<_> = components.list.iter().map(|c| (c.pixels, c.at_border)).collect();
        assert_eq!(found, [(10, false), (1, true)]);
        assert_eq!(components.at(4, 2), Some(0));
        assert_eq!(components.at(3, 2), None);
        components.find(&image, false);
        let found: Vec<_> = components.list.iter().map(|c| (c.pixels, c.at_border)).collect();
        assert_eq!(found, [(22, true), (2, false)]);
    }

    #[test]
    fn runs_cross_words_and_end_with_the_image() {
        for width in [1, 63, 64, 65, 127, 128, 130] {
            let mut image = BitImage::new(width, 2);
            image.set_run(0, 0, width);
            image.set(width - 1, 1);
            let mut components = Components::new(width, 2);
            components.find(&image, true);
            assert_eq!(components.runs.len(), 2, "width {width}");
            assert_eq!(components.list.len(), 1, "width {width}");
            assert_eq!(components.list[0].pixels as usize, width + 1);
            components.find(&image, false);
            assert_eq!(components.runs.len(), usize::from(width > 1), "width {width}");
        }
    }

    #[test]
    fn a_u_joins_late() {
        let mut components = Components::new(5, 3);
        components.find(
            &parse(
                "#...#
                 #...#
                 #####",
            ),
            true,
        );
        assert_eq!(components.list.len(), 1);
        assert_eq!(components.list[0].pixels, 9);
    }
}
