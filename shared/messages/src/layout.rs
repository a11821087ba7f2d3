//! A type's layout as a number, computed at compile time.
//!
//! iceoryx2 accepts two types of one name and size even when their fields are permuted. So the
//! name of every message ends in a hash over its fields' names, offsets, sizes and types, down to
//! the last scalar.

/// FNV-1a's offset basis.
const SEED: u64 = 0xcbf2_9ce4_8422_2325;
/// FNV-1a's prime.
const PRIME: u64 = 0x0000_0100_0000_01b3;
/// Hexadecimal digits of a hash in a type name.
pub const HASH_DIGITS: usize = 16;

/// A type whose layout has a hash.
pub trait Layout {
    /// Hash over field names, offsets, sizes and types, recursively.
    const HASH: u64;

    /// What it looks like, for programs in other languages.
    fn shape() -> Shape;
}

/// What a type looks like in memory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Shape {
    /// A number, by Rust's name.
    Scalar(&'static str),
    /// So many of one type, one after the other.
    Array(Box<Shape>, usize),
    /// Fields in order, without gaps that mean anything.
    Struct {
        /// Rust's name.
        name: &'static str,
        /// Its size, bytes.
        size: usize,
        /// Its fields.
        fields: Vec<FieldShape>,
    },
}

/// One field of a [`Shape::Struct`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FieldShape {
    /// Its name.
    pub name: &'static str,
    /// Bytes from the beginning of the struct.
    pub offset: usize,
    /// What it is.
    pub shape: Shape,
}

/// Continues a hash over bytes (FNV-1a, 64 bits).
pub const fn mix(mut hash: u64, bytes: &[u8]) -> u64 {
    let mut k = 0;
    while k < bytes.len() {
        hash = (hash ^ bytes[k] as u64).wrapping_mul(PRIME);
        k += 1;
    }
    hash
}

/// Continues a hash over one number.
pub const fn mix_u64(hash: u64, number: u64) -> u64 {
    mix(hash, &number.to_le_bytes())
}

/// The hash of nothing but a name.
pub const fn named(name: &str) -> u64 {
    mix(SEED, name.as_bytes())
}

/// Continues a hash over one field: its name, place, size and type.
pub const fn field(hash: u64, name: &str, offset: usize, size: usize, type_hash: u64) -> u64 {
    let hash = mix(hash, name.as_bytes());
    mix_u64(mix_u64(mix_u64(hash, offset as u64), size as u64), type_hash)
}

/// `base` followed by a dot and the hash in hexadecimal; `N` is the length of that.
pub const fn type_name<const N: usize>(base: &str, hash: u64) -> [u8; N] {
    assert!(N == base.len() + 1 + HASH_DIGITS, "the length is that of the name, a dot and a hash");
    let mut name = [b'.'; N];
    let mut k = 0;
    while k < base.len() {
        name[k] = base.as_bytes()[k];
        k += 1;
    }
    let mut digit = 0;
    while digit < HASH_DIGITS {
        let nibble = (hash >> (4 * (HASH_DIGITS - 1 - digit))) & 0xf;
        name[base.len() + 1 + digit] = b"0123456789abcdef"[nibble as usize];
        digit += 1;
    }
    name
}

macro_rules! scalar_layouts {
    ($($scalar:ty),*) => {
        $(impl Layout for $scalar {
            const HASH: u64 = named(stringify!($scalar));

            fn shape() -> Shape {
                Shape::Scalar(stringify!($scalar))
            }
        })*
    };
}
scalar_layouts!(i8, u8, u16, u32, u64, f32, f64);

impl<T: Layout, const N: usize> Layout for [T; N] {
    const HASH: u64 = mix_u64(mix(T::HASH, b"array"), N as u64);

    fn shape() -> Shape {
        Shape::Array(Box::new(T::shape()), N)
    }
}

/// Gives a `repr(C)` struct of another crate a layout hash. Every field must be listed: the
/// pattern does not compile otherwise, nor does a field of another type.
#[macro_export]
macro_rules! layout {
    ($name:ident { $($field:ident : $type:ty),* $(,)? }) => {
        impl $crate::layout::Layout for $name {
            const HASH: u64 = {
                let hash = $crate::layout::named(stringify!($name));
                $(let hash = $crate::layout::field(
                    hash,
                    stringify!($field),
                    ::core::mem::offset_of!($name, $field),
                    ::core::mem::size_of::<$type>(),
                    <$type as $crate::layout::Layout>::HASH,
                );)*
                hash
            };

            fn shape() -> $crate::layout::Shape {
                $crate::layout::Shape::Struct {
                    name: stringify!($name),
                    size: ::core::mem::size_of::<$name>(),
                    fields: vec![$($crate::layout::FieldShape {
                        name: stringify!($field),
                        offset: ::core::mem::offset_of!($name, $field),
                        shape: <$type as $crate::layout::Layout>::shape(),
                    }),*],
                }
            }
        }
        const _: fn(&$name) = |value| {
            let $name { $($field),* } = value;
            $(let _: &$type = $field;)*
        };
    };
}

/// Declares a message: `repr(C)`, plain old data without padding, with its layout in its name.
///
/// The first field must be `header: Header`.
#[macro_export]
macro_rules! message {
    (
        $(#[$meta:meta])*
        pub struct $name:ident as $wire:literal {
            $($(#[$field_meta:meta])* pub $field:ident : $type:ty),* $(,)?
        }
    ) => {
        $(#[$meta])*
        #[repr(C)]
        #[derive(Debug, Clone, Copy, ::bytemuck::Pod, ::bytemuck::Zeroable)]
        pub struct $name {
            $($(#[$field_meta])* pub $field : $type),*
        }

        $crate::layout!($name { $($field : $type),* });

        impl $crate::Message for $name {
            const TYPE_NAME: &'static str = {
                const BYTES: [u8; $wire.len() + 1 + $crate::layout::HASH_DIGITS] =
                    $crate::layout::type_name(
                        $wire,
                        <$name as $crate::layout::Layout>::HASH,
                    );
                match ::core::str::from_utf8(&BYTES) {
                    Ok(name) => name,
                    Err(_) => panic!("a message's name is ASCII"),
                }
            };

            fn header(&self) -> &$crate::Header {
                &self.header
            }

            fn header_mut(&mut self) -> &mut $crate::Header {
                &mut self.header
            }
        }
    };
}
