use super::*;

/// Every operation once, on awkward numbers.
struct Everything<'a>(&'a mut Vec<u32>);

impl Pass for Everything<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let a: [f32; LANES] = std::array::from_fn(|k| (0..k).fold(1e-7, |a, _| 7.0 * a) + 0.3);
        let b: [f32; LANES] = std::array::from_fn(|k| 3.7 - 0.61 * k as f32);
        let mut out = [0f32; LANES];
        // SAFETY: the arrays have sixteen numbers.
        let (a, b) = unsafe { (V::load(a.as_ptr()), V::load(b.as_ptr())) };
        let results = [
            a.add(b),
            a.sub(b),
            a.mul(b),
            a.mul_add(b, V::splat(-0.7)),
            a.div(b),
            a.min(b),
            a.max(b),
            a.keep(0b1010_0110_1111_0001),
            a.select(b, 0b0110_0101_1000_1110),
            a.inverse_sqrt(),
            b.add(V::splat(ROUND)).two_to(),
            V::splat(0.1).mul(b),
        ];
        for result in results {
            // SAFETY: `out` has sixteen numbers.
            unsafe { result.store(out.as_mut_ptr()) };
            self.0.extend(out.map(f32::to_bits));
        }
        self.0.push(u32::from(a.above(b)));
    }
}

#[test]
fn every_width_gives_the_same_bits() {
    let mut portable = Vec::new();
    Width::Portable.run(Everything(&mut portable));
    assert_eq!(portable.len(), 12 * LANES + 1);
    for width in Width::available() {
        let mut bits = Vec::new();
        width.run(Everything(&mut bits));
        assert_eq!(bits, portable, "{width:?}");
    }
}

#[test]
fn powers_of_two_are_exact() {
    for k in -126..=127 {
        assert_eq!(Lanes::two_to([ROUND + k as f32; LANES])[7], (k as f32).exp2());
    }
}

#[test]
fn the_inverse_root_is_right_over_all_lengths() {
    let mut x = 1e-18f32;
    while x < 1e12 {
        let found = Lanes::inverse_sqrt([x; LANES])[3];
        let exact = 1.0 / f64::from(x).sqrt();
        assert!((f64::from(found) / exact - 1.0).abs() < 3e-7, "1/√{x} = {found}");
        x *= 1.37;
    }
}
