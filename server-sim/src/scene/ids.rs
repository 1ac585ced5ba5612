//! Ids of a scene's parts: positions in the scene's own tables, in file order.

/// Declares an id that is a position in one table of the scene.
macro_rules! id {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $name(pub u32);

        impl $name {
            /// The id of the `index`-th entry. Tables are limited to far below `u32::MAX` entries.
            #[must_use]
            pub(crate) fn at(index: usize) -> Self {
                Self(u32::try_from(index).unwrap_or(u32::MAX))
            }

            /// Position in the table.
            #[must_use]
            pub fn index(self) -> usize {
                self.0 as usize
            }
        }
    };
}

id! {
    /// An instance: one primitive at one node ([`Scene::instances`](crate::scene::Scene::instances)).
    InstanceId
}
id! {
    /// A mesh: one primitive as it was modelled ([`Scene::meshes`](crate::scene::Scene::meshes)).
    MeshId
}
id! {
    /// A material ([`Scene::materials`](crate::scene::Scene::materials)).
    MaterialId
}
id! {
    /// A mesh in metric local space ([`Scene::rests`](crate::scene::Scene::rests)).
    RestId
}
