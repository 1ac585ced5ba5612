//! The macro that declares ids of one byte on the wire.

/// Declares a wire id: a newtype of `u8` with its known values and the text of each.
///
/// A value that this version does not know survives reading and prints as the text after `unknown` and its number.
macro_rules! wire_enum {
    (
        $(#[$attribute:meta])*
        $id:ident, unknown $unknown:literal;
        $($(#[$value_attribute:meta])* $name:ident = $value:literal => $text:literal,)+
    ) => {
        $(#[$attribute])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $id(pub u8);

        impl $id {
            $($(#[$value_attribute])* pub const $name: $id = $id($value);)+

            /// Every known value, in ascending order.
            pub const ALL: [$id; [$($value),+].len()] = [$($id::$name),+];
        }

        impl std::fmt::Display for $id {
            fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                match *self {
                    $($id::$name => out.write_str($text),)+
                    $id(other) => write!(out, concat!($unknown, " {}"), other),
                }
            }
        }
    };
}

pub(crate) use wire_enum;
