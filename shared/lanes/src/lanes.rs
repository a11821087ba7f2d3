//! Sixteen numbers at a time: AVX-512, AVX2 and portable code that give the same bits.
//!
//! Products and sums are fused where a pass says so and nowhere else, and the inverse root is made
//! of the same operations everywhere, so that a pass written once over [`Lanes`] has one result.

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::*;

/// Numbers in a vector.
pub const LANES: usize = 16;

/// Sixteen `f32`.
pub trait Lanes: Copy {
    /// All lanes alike.
    fn splat(value: f32) -> Self;
    /// Sixteen numbers from `from` on.
    ///
    /// # Safety
    /// They must be readable; no alignment is needed.
    unsafe fn load(from: *const f32) -> Self;
    /// Writes sixteen numbers.
    ///
    /// # Safety
    /// They must be writable; no alignment is needed.
    unsafe fn store(self, to: *mut f32);
    /// Sum.
    fn add(self, other: Self) -> Self;
    /// Difference.
    fn sub(self, other: Self) -> Self;
    /// Product.
    fn mul(self, other: Self) -> Self;
    /// `self`·`factor` + `summand`, rounded once. Slow in portable code for a machine without such
    /// an instruction.
    fn mul_add(self, factor: Self, summand: Self) -> Self;
    /// Quotient.
    fn div(self, other: Self) -> Self;
    /// The smaller of the two; `other` where `self` is NaN.
    fn min(self, other: Self) -> Self;
    /// The greater of the two; `other` where `self` is NaN.
    fn max(self, other: Self) -> Self;
    /// Lanes whose bit is set (bit 0 is lane 0) from `self`, zero elsewhere.
    fn keep(self, bits: u16) -> Self;
    /// A bit per lane: whether it exceeds `other`'s.
    fn above(self, other: Self) -> u16;
    /// Lanes whose bit is set from `self`, the others from `other`.
    fn select(self, other: Self, bits: u16) -> Self;
    /// `magic − bits/2`, the first guess at an inverse root.
    fn root_guess(self) -> Self;
    /// 2^k where `self` is k + [`ROUND`] for a whole k of −126 to 127.
    fn two_to(self) -> Self;

    /// 1/√x for positive, normal x, to 2 units in the last place.
    #[inline(always)]
    fn inverse_sqrt(self) -> Self {
        let half = self.mul(Self::splat(0.5));
        let mut y = self.root_guess();
        for _ in 0..3 {
            y = y.mul(Self::splat(1.5).sub(half.mul(y).mul(y)));
        }
        y
    }
}

const GUESS: i32 = 0x5f37_59df;

/// 1.5·2²³: a sum with it is rounded to a whole number, which then stands in its lowest bits.
pub const ROUND: f32 = 12_582_912.0;
/// What turns those bits into an exponent's.
const EXPONENT: i32 = 127 - ROUND.to_bits() as i32;

impl Lanes for [f32; LANES] {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        [value; LANES]
    }
    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: the caller's.
        unsafe { from.cast::<Self>().read_unaligned() }
    }
    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: the caller's.
        unsafe { to.cast::<Self>().write_unaligned(self) }
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        std::array::from_fn(|k| self[k] + other[k])
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        std::array::from_fn(|k| self[k] - other[k])
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        std::array::from_fn(|k| self[k] * other[k])
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, summand: Self) -> Self {
        std::array::from_fn(|k| self[k].mul_add(factor[k], summand[k]))
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        std::array::from_fn(|k| self[k] / other[k])
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        std::array::from_fn(|k| if self[k] < other[k] { self[k] } else { other[k] })
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        std::array::from_fn(|k| if self[k] > other[k] { self[k] } else { other[k] })
    }
    #[inline(always)]
    fn keep(self, bits: u16) -> Self {
        std::array::from_fn(|k| if bits >> k & 1 == 1 { self[k] } else { 0.0 })
    }
    #[inline(always)]
    fn above(self, other: Self) -> u16 {
        (0..LANES).fold(0, |bits, k| bits | u16::from(self[k] > other[k]) << k)
    }
    #[inline(always)]
    fn select(self, other: Self, bits: u16) -> Self {
        std::array::from_fn(|k| if bits >> k & 1 == 1 { self[k] } else { other[k] })
    }
    #[inline(always)]
    fn two_to(self) -> Self {
        self.map(|x| f32::from_bits(((x.to_bits() as i32).wrapping_add(EXPONENT) << 23) as u32))
    }
    #[inline(always)]
    fn root_guess(self) -> Self {
        self.map(|x| f32::from_bits((GUESS.wrapping_sub((x.to_bits() >> 1) as i32)) as u32))
    }
}

/// Sixteen numbers in one register.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy)]
pub struct Avx512(__m512);

/// Implements a binary operation of [`Lanes`] by one instruction.
#[cfg(target_arch = "x86_64")]
macro_rules! by_avx512 {
    ($($name:ident $intrinsic:ident)*) => {$(
        #[inline(always)]
        fn $name(self, other: Self) -> Self {
            // SAFETY: values of this type are only made where AVX-512 was detected.
            Self(unsafe { $intrinsic(self.0, other.0) })
        }
    )*};
}

#[cfg(target_arch = "x86_64")]
impl Lanes for Avx512 {
    by_avx512! {
        add _mm512_add_ps
        sub _mm512_sub_ps
        mul _mm512_mul_ps
        div _mm512_div_ps
        min _mm512_min_ps
        max _mm512_max_ps
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, summand: Self) -> Self {
        // SAFETY: values of this type are only made where AVX-512 was detected.
        Self(unsafe { _mm512_fmadd_ps(self.0, factor.0, summand.0) })
    }
    #[inline(always)]
    fn splat(value: f32) -> Self {
        // SAFETY: only called where AVX-512 was detected.
        Self(unsafe { _mm512_set1_ps(value) })
    }
    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: the caller's.
        Self(unsafe { _mm512_loadu_ps(from) })
    }
    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: the caller's.
        unsafe { _mm512_storeu_ps(to, self.0) }
    }
    #[inline(always)]
    fn keep(self, bits: u16) -> Self {
        // SAFETY: values of this type are only made where AVX-512 was detected.
        Self(unsafe { _mm512_maskz_mov_ps(bits, self.0) })
    }
    #[inline(always)]
    fn above(self, other: Self) -> u16 {
        // SAFETY: values of this type are only made where AVX-512 was detected.
        unsafe { _mm512_cmp_ps_mask::<_CMP_GT_OQ>(self.0, other.0) }
    }
    #[inline(always)]
    fn select(self, other: Self, bits: u16) -> Self {
        // SAFETY: values of this type are only made where AVX-512 was detected.
        Self(unsafe { _mm512_mask_mov_ps(other.0, bits, self.0) })
    }
    #[inline(always)]
    fn two_to(self) -> Self {
        // SAFETY: values of this type are only made where AVX-512 was detected.
        unsafe {
            let k = _mm512_add_epi32(_mm512_castps_si512(self.0), _mm512_set1_epi32(EXPONENT));
            Self(_mm512_castsi512_ps(_mm512_slli_epi32::<23>(k)))
        }
    }
    #[inline(always)]
    fn root_guess(self) -> Self {
        // SAFETY: values of this type are only made where AVX-512 was detected.
        unsafe {
            let half = _mm512_srli_epi32::<1>(_mm512_castps_si512(self.0));
            Self(_mm512_castsi512_ps(_mm512_sub_epi32(_mm512_set1_epi32(GUESS), half)))
        }
    }
}

/// Sixteen numbers in two registers.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy)]
pub struct Avx2([__m256; 2]);

/// Implements a binary operation of [`Lanes`] by one instruction a half.
#[cfg(target_arch = "x86_64")]
macro_rules! by_avx2 {
    ($($name:ident $intrinsic:ident)*) => {$(
        #[inline(always)]
        fn $name(self, other: Self) -> Self {
            let ([a, b], [c, d]) = (self.0, other.0);
            // SAFETY: values of this type are only made where AVX2 was detected.
            Self(unsafe { [$intrinsic(a, c), $intrinsic(b, d)] })
        }
    )*};
}

#[cfg(target_arch = "x86_64")]
impl Lanes for Avx2 {
    by_avx2! {
        add _mm256_add_ps
        sub _mm256_sub_ps
        mul _mm256_mul_ps
        div _mm256_div_ps
        min _mm256_min_ps
        max _mm256_max_ps
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, summand: Self) -> Self {
        let ([a, b], [c, d], [e, f]) = (self.0, factor.0, summand.0);
        // SAFETY: values of this type are only made where AVX2 and FMA were detected.
        Self(unsafe { [_mm256_fmadd_ps(a, c, e), _mm256_fmadd_ps(b, d, f)] })
    }
    #[inline(always)]
    fn splat(value: f32) -> Self {
        // SAFETY: only called where AVX2 was detected.
        Self([unsafe { _mm256_set1_ps(value) }; 2])
    }
    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: the caller's.
        Self(unsafe { [_mm256_loadu_ps(from), _mm256_loadu_ps(from.add(8))] })
    }
    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: the caller's.
        unsafe {
            _mm256_storeu_ps(to, self.0[0]);
            _mm256_storeu_ps(to.add(8), self.0[1]);
        }
    }
    #[inline(always)]
    fn keep(self, bits: u16) -> Self {
        // SAFETY: values of this type are only made where AVX2 was detected.
        unsafe {
            let [low, high] = masks(bits);
            Self([_mm256_and_ps(self.0[0], low), _mm256_and_ps(self.0[1], high)])
        }
    }
    #[inline(always)]
    fn select(self, other: Self, bits: u16) -> Self {
        // SAFETY: values of this type are only made where AVX2 was detected.
        unsafe {
            let [low, high] = masks(bits);
            let ([a, b], [c, d]) = (self.0, other.0);
            Self([_mm256_blendv_ps(c, a, low), _mm256_blendv_ps(d, b, high)])
        }
    }
    #[inline(always)]
    fn two_to(self) -> Self {
        // SAFETY: values of this type are only made where AVX2 was detected.
        unsafe {
            let exponent = _mm256_set1_epi32(EXPONENT);
            let low = _mm256_add_epi32(_mm256_castps_si256(self.0[0]), exponent);
            let high = _mm256_add_epi32(_mm256_castps_si256(self.0[1]), exponent);
            let low = _mm256_castsi256_ps(_mm256_slli_epi32::<23>(low));
            Self([low, _mm256_castsi256_ps(_mm256_slli_epi32::<23>(high))])
        }
    }
    #[inline(always)]
    fn above(self, other: Self) -> u16 {
        // SAFETY: values of this type are only made where AVX2 was detected.
        unsafe {
            let low = _mm256_cmp_ps::<_CMP_GT_OQ>(self.0[0], other.0[0]);
            let high = _mm256_cmp_ps::<_CMP_GT_OQ>(self.0[1], other.0[1]);
            _mm256_movemask_ps(low) as u16 | (_mm256_movemask_ps(high) as u16) << 8
        }
    }
    #[inline(always)]
    fn root_guess(self) -> Self {
        // SAFETY: values of this type are only made where AVX2 was detected.
        unsafe {
            let guess = _mm256_set1_epi32(GUESS);
            let low = _mm256_srli_epi32::<1>(_mm256_castps_si256(self.0[0]));
            let high = _mm256_srli_epi32::<1>(_mm256_castps_si256(self.0[1]));
            let low = _mm256_castsi256_ps(_mm256_sub_epi32(guess, low));
            Self([low, _mm256_castsi256_ps(_mm256_sub_epi32(guess, high))])
        }
    }
}

/// All bits of the lanes whose bit is set.
///
/// # Safety
/// There must be AVX2.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
unsafe fn masks(bits: u16) -> [__m256; 2] {
    // SAFETY: the caller's.
    unsafe {
        let lane = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
        let low = _mm256_and_si256(_mm256_set1_epi32(i32::from(bits)), lane);
        let high = _mm256_and_si256(_mm256_set1_epi32(i32::from(bits >> 8)), lane);
        let low = _mm256_castsi256_ps(_mm256_cmpeq_epi32(low, lane));
        [low, _mm256_castsi256_ps(_mm256_cmpeq_epi32(high, lane))]
    }
}

/// A pass over the nodes or links, written once for every kind of [`Lanes`].
pub trait Pass {
    /// Runs it; must be `#[inline(always)]`.
    fn run<V: Lanes>(self);
}

/// Sixteen points.
pub type Points<V> = [V; 3];

// Functions, and no closures or `array::map`: only what is always inlined becomes vector code.

/// Sixteen points from `at` on.
///
/// # Safety
/// As [`Lanes::load`], for each of the three.
#[inline(always)]
pub unsafe fn load_points<V: Lanes>(from: [*const f32; 3], at: usize) -> Points<V> {
    // SAFETY: the caller's.
    unsafe { [V::load(from[0].add(at)), V::load(from[1].add(at)), V::load(from[2].add(at))] }
}

/// Writes sixteen points.
///
/// # Safety
/// As [`Lanes::store`], for each of the three.
#[inline(always)]
pub unsafe fn store_points<V: Lanes>(points: Points<V>, to: [*mut f32; 3], at: usize) {
    // SAFETY: the caller's.
    unsafe {
        points[0].store(to[0].add(at));
        points[1].store(to[1].add(at));
        points[2].store(to[2].add(at));
    }
}

/// a + b.
#[inline(always)]
pub fn plus<V: Lanes>(a: Points<V>, b: Points<V>) -> Points<V> {
    [a[0].add(b[0]), a[1].add(b[1]), a[2].add(b[2])]
}

/// a − b.
#[inline(always)]
pub fn minus<V: Lanes>(a: Points<V>, b: Points<V>) -> Points<V> {
    [a[0].sub(b[0]), a[1].sub(b[1]), a[2].sub(b[2])]
}

/// a·s.
#[inline(always)]
pub fn times<V: Lanes>(a: Points<V>, s: V) -> Points<V> {
    [a[0].mul(s), a[1].mul(s), a[2].mul(s)]
}

/// a·b, each step rounded once.
#[inline(always)]
pub fn fused_dot<V: Lanes>(a: Points<V>, b: Points<V>) -> V {
    a[2].mul_add(b[2], a[1].mul_add(b[1], a[0].mul(b[0])))
}

/// a·b.
#[inline(always)]
pub fn dot<V: Lanes>(a: Points<V>, b: Points<V>) -> V {
    a[0].mul(b[0]).add(a[1].mul(b[1])).add(a[2].mul(b[2]))
}

/// The widest vectors that this machine has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Width {
    /// AVX-512.
    #[cfg(target_arch = "x86_64")]
    Avx512,
    /// AVX2 and FMA.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// Whatever the compiler makes of it.
    Portable,
}

impl Width {
    /// Every width that this machine has, the widest first.
    pub fn available() -> Vec<Self> {
        let mut widths = Vec::new();
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx512f") {
                widths.push(Self::Avx512);
            }
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                widths.push(Self::Avx2);
            }
        }
        widths.push(Self::Portable);
        widths
    }

    /// Runs a pass. `self` must be one of [`Width::available`].
    pub fn run<P: Pass>(self, pass: P) {
        match self {
            // SAFETY: the width is only made where its feature was detected.
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => unsafe { avx512(pass) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => unsafe { avx2(pass) },
            Self::Portable => pass.run::<[f32; LANES]>(),
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn avx512<P: Pass>(pass: P) {
    pass.run::<Avx512>();
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn avx2<P: Pass>(pass: P) {
    pass.run::<Avx2>();
}

#[cfg(test)]
mod tests;
