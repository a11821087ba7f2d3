//! Clusters of colours.

use crate::color_model::{Feature, distance_squared};

/// Centres of at most `k` clusters of `samples`: k-means++ from a seeded start, 20 rounds.
///
/// Source: Arthur & Vassilvitskii, SODA 2007. Equal samples and seed give equal centres.
pub(crate) fn k_means(samples: &[Feature], k: usize, seed: u64) -> Vec<Feature> {
    let mut centres = Vec::with_capacity(k);
    let mut gaps = vec![f32::INFINITY; samples.len()];
    for round in 0..k {
        let total: f64 = gaps.iter().map(|g| f64::from(*g)).sum();
        let pick = if round == 0 {
            samples.len() / 2
        } else {
            let target = uniform(seed, round as u64) * total;
            let mut sum = 0.0;
            gaps.iter()
                .take_while(|g| {
                    sum += f64::from(**g);
                    sum < target
                })
                .count()
        };
        // Fewer distinct samples than centres, or none at all.
        if round > 0 && total <= 1e-6 {
            break;
        }
        let Some(centre) = samples.get(pick) else { break };
        centres.push(*centre);
        for (gap, sample) in gaps.iter_mut().zip(samples) {
            *gap = gap.min(distance_squared(sample, centre));
        }
    }
    for _ in 0..20 {
        refine(&mut centres, samples);
    }
    centres
}

/// One round of Lloyd's iteration.
fn refine(centres: &mut [Feature], samples: &[Feature]) {
    let mut sums = vec![([0.0; 3], 0.0); centres.len()];
    for sample in samples {
        let of = |c: &Feature| distance_squared(sample, c);
        let owner = (0..centres.len()).min_by(|a, b| of(&centres[*a]).total_cmp(&of(&centres[*b])));
        if let Some((sum, count)) = owner.map(|k| &mut sums[k]) {
            (0..3).for_each(|axis| sum[axis] += f64::from(sample[axis]));
            *count += 1.0;
        }
    }
    for (centre, (sum, count)) in centres.iter_mut().zip(sums) {
        if count > 0.0 {
            *centre = sum.map(|s| (s / count) as f32);
        }
    }
}

/// A number in [0, 1) from a seed and a counter (SplitMix64).
fn uniform(seed: u64, counter: u64) -> f64 {
    let mut x = seed.wrapping_add(counter.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ x >> 31) >> 11) as f64 / (1u64 << 53) as f64
}
