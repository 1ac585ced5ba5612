//! The definition of all wire codes.

/// Defines a wire code: a number with names for some values. The type is a newtype, not an enum, so that unknown values
/// survive reading and writing. `unknown` is the noun for such a value.
macro_rules! wire_enum {
    (
        $(#[$attribute:meta])*
        pub struct $code:ident($number:ty), unknown $noun:literal {
            $($(#[$doc:meta])* $value:ident = $wire:literal => $text:literal,)*
        }
    ) => {
        $(#[$attribute])*
        #[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $code(pub $number);

        impl $code {
            $($(#[$doc])* pub const $value: Self = Self($wire);)*

            /// Returns the name of the value, or `None` for a value that this version does not know.
            #[must_use]
            pub const fn name(self) -> Option<&'static str> {
                Some(match self {
                    $(Self::$value => $text,)*
                    _ => return None,
                })
            }
        }

        impl std::fmt::Display for $code {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                match self.name() {
                    Some(name) => f.pad(name),
                    None => f.pad(&format!(concat!($noun, " {}"), self.0)),
                }
            }
        }

        impl std::fmt::Debug for $code {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                std::fmt::Display::fmt(self, f)
            }
        }
    };
}
