//! Builder methods of settings.

/// Defines a `with_...` method for each field of a settings type.
macro_rules! setters {
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
