//! The kernels compiled for each CPU feature set, chosen at run time: a portable build uses the
//! vectors it finds.
//!
//! This is the crate's only `unsafe`: calling a function compiled for a CPU feature, directly after
//! the check that the CPU has it. The functions themselves are the same safe code with the same
//! bits (see [`super::analytic`]).
#![allow(unsafe_code)]

use super::targets::Targets;
use super::{Chunk, Directions, analytic, noise};

/// Defines a function that runs `$body` with the widest vectors the CPU has.
macro_rules! with_widest_vectors {
    ($(#[$doc:meta])* $name:ident => $body:path, ($($arg:ident: $type:ty),*) $(-> $return:ty)?) => {
        $(#[$doc])*
        #[inline]
        pub(crate) fn $name($($arg: $type),*) $(-> $return)? {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2")]
                fn avx2($($arg: $type),*) $(-> $return)? {
                    $body($($arg),*)
                }
                if std::arch::is_x86_feature_detected!("avx2") {
                    // SAFETY: the CPU has AVX2.
                    return unsafe { avx2($($arg),*) };
                }
            }
            $body($($arg),*)
        }
    };
}

with_widest_vectors!(
    /// [`analytic::cast`] with the widest vectors the CPU has.
    cast => analytic::cast, (directions: &Directions, targets: &Targets, ranges: &mut [Chunk]) -> f32
);
with_widest_vectors!(
    /// [`noise::noisy_frame`] with the widest vectors the CPU has.
    noisy_frame => noise::noisy_frame, (ranges: &[f32], random: &[u8], std: f32, range: f32, out: &mut [f32])
);

#[cfg(test)]
mod tests {
    use super::super::LANES;
    use super::*;
    use crate::config::LaserConfig;
    use crate::geometry::{Pose, Shape};
    use crate::world::World;
    use glam::Vec2;

    /// The portable build of a kernel and the one chosen by the CPU give the same bits.
    #[test]
    fn every_variant_gives_the_same_bits() {
        let mut world = World::new();
        world.set_walls(Vec2::splat(-10.0), Vec2::splat(10.0)).expect("walls");
        for i in 0..7 {
            let pose = Pose::new(Vec2::new(i as f32 - 3.2, 2.0 - 0.9 * i as f32), 0.7 * i as f32);
            let shape = if i % 2 == 0 { Shape::square(0.5) } else { Shape::Circle { radius: 0.3 } };
            world.add_body(&shape, pose).expect("body");
        }
        let directions = Directions::new(&LaserConfig::default());
        let mut targets = Targets::default();
        let sensor = Pose::new(Vec2::new(0.3, 4.0), 1.0);
        targets.collect(&world, sensor, |_| true, &LaserConfig::default());
        let (mut wide, mut portable) = ([[0.0; LANES]; 64], [[0.0; LANES]; 64]);
        cast(&directions, &targets, &mut wide);
        analytic::cast(&directions, &targets, &mut portable);
        assert_eq!(wide.map(|c| c.map(f32::to_bits)), portable.map(|c| c.map(f32::to_bits)));
        let random: Vec<u8> = (0..2048_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
        let (mut a, mut b) = ([0.0; 512], [0.0; 512]);
        noisy_frame(wide.as_flattened(), &random, 0.02, 10.0, &mut a);
        noise::noisy_frame(wide.as_flattened(), &random, 0.02, 10.0, &mut b);
        assert_eq!(a.map(f32::to_bits), b.map(f32::to_bits));
    }
}
