//! Features that an instance needs.

use bincode::{Decode, Encode};

bitflags::bitflags! {
    /// Features that an instance needs from a server or client. Unknown bits are kept.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
    pub struct Needs: u32 {
        /// Its vertices follow joints.
        const SKIN = 1;
        /// Its vertices follow morph targets.
        const MORPH = 1 << 1;
        /// It moves as a rigid body. A deforming one may move as well.
        const RIGID_MOTION = 1 << 2;
        /// Its scale or shear changes over time.
        const ANIMATED_SCALE = 1 << 3;
        /// A texture decides where its surface is.
        const MASKED = 1 << 4;
        /// Both of its sides are visible.
        const DOUBLE_SIDED = 1 << 5;
        /// A normal map bends its normals.
        const NORMAL_MAP = 1 << 6;

        // The other bits belong to later versions.
        const _ = !0;
    }
}

impl Needs {
    /// No features: a still, opaque, one-sided surface.
    pub const NONE: Self = Self::empty();

    const NAMES: [(Self, &'static str); 7] = [
        (Self::SKIN, "skin"),
        (Self::MORPH, "morph"),
        (Self::RIGID_MOTION, "rigid motion"),
        (Self::ANIMATED_SCALE, "animated scale"),
        (Self::MASKED, "mask"),
        (Self::DOUBLE_SIDED, "double-sided"),
        (Self::NORMAL_MAP, "normal map"),
    ];

    /// Returns the names of all known needs in the set, for display.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        Self::NAMES.iter().filter(move |(need, _)| self.contains(*need)).map(|(_, name)| *name)
    }
}

impl Encode for Needs {
    fn encode<E: bincode::enc::Encoder>(&self, to: &mut E) -> Result<(), bincode::error::EncodeError> {
        self.bits().encode(to)
    }
}

impl<C> Decode<C> for Needs {
    fn decode<D: bincode::de::Decoder<Context = C>>(
        from: &mut D,
    ) -> Result<Self, bincode::error::DecodeError> {
        u32::decode(from).map(Self::from_bits_retain)
    }
}

bincode::impl_borrow_decode!(Needs);
