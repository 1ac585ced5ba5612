//! The numbers of a point, each with its own type.

/// Declares a type for a number of points.
macro_rules! number {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $name(pub u32);

        impl $name {
            /// Returns the number as an index into a list.
            #[must_use]
            #[inline(always)]
            pub fn index(self) -> usize {
                self.0 as usize
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                self.0.fmt(f)
            }
        }
    };
}

number! {
    /// Number of a point in the scene: the points of all instances, in the order of the instances
    /// ([`ScenePoints::offsets`](super::ScenePoints::offsets)).
    PointId
}
number! {
    /// Index of a point in its set, and so in every instance of the set.
    PointInSet
}
number! {
    /// Number that selects the rays of a point: its rank in the order of creation, over all instances. It stays with
    /// the point when its set is reordered.
    RayKey
}
