//! The numbers of a point, each with a type of its own.

/// Declares a number of points.
macro_rules! number {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $name(pub u32);

        impl $name {
            /// Returns the index into a list of all of them.
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
    /// Chooses the rays of a point: the number of the point in the order in which points were made, over all instances. It
    /// stays with the point when its set is put into another order.
    RayKey
}
