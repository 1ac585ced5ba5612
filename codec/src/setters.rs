//! Builder methods of settings.

/// Defines a `with_...` method for each field of a settings type. `const fn:` in front makes them constant functions,
/// for fields without a destructor.
///
/// It is for the crates of this workspace only.
#[doc(hidden)]
#[macro_export]
macro_rules! setters {
    (const fn: $($method:ident: $field:ident as $type:ty,)*) => {
        $(
            #[doc = concat!("Sets [`", stringify!($field), "`](Self::", stringify!($field), ").")]
            #[must_use]
            pub const fn $method(mut self, $field: $type) -> Self {
                self.$field = $field;
                self
            }
        )*
    };
    ($($method:ident: $field:ident as $type:ty,)*) => {
        $(
            #[doc = concat!("Sets [`", stringify!($field), "`](Self::", stringify!($field), ").")]
            #[must_use]
            pub fn $method(mut self, $field: $type) -> Self {
                self.$field = $field;
                self
            }
        )*
    };
}
