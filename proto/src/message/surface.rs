//! Scene table entries of profile `surface`: point sets, and instances of them.

use bincode::{Decode, Encode};
use psao_codec::surface::{GeometryDigest, GeometrySource, Levels, MAX_CHARTS, MAX_LEVELS, SetLayout};

use super::{FieldError, MAX_BATCH, Needs, finite, require};

wire_enum! {
    /// Source of the points at clients of a `surface` stream. Unknown values are kept.
    #[derive(Default, Encode, Decode)]
    pub struct PointSource(u8), unknown "geometry" {
        /// Keyframes carry the points. Streams of other profiles also have this value.
        SENT = 0 => "sent",
        /// Clients compute the points from the scene and the stream's density, minimum and seed.
        SHARED = 1 => "shared",
    }
}

impl From<GeometrySource> for PointSource {
    fn from(source: GeometrySource) -> Self {
        match source {
            GeometrySource::Sent => Self::SENT,
            GeometrySource::Shared => Self::SHARED,
        }
    }
}

/// The points of one mesh at rest.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub struct SetEntry {
    /// First node of the lattice to which positions are rounded, metres, rest space.
    pub origin: [f32; 3],
    /// Distance of neighbouring nodes, metres, positive.
    pub step: f32,
    /// Largest coordinate along each axis.
    pub extent: [u32; 3],
    /// Bits of one axis of a normal's code, 2 to 8.
    pub normal_bits: u8,
    /// Points.
    pub points: u32,
    /// Charts, 1 to 2^24 if there are points.
    pub charts: u32,
    /// Levels, 1 to [`MAX_LEVELS`].
    pub levels: u8,
    /// Points in each level and all coarser ones, ascending, for all levels but the last; 0 for levels that the set does not
    /// have.
    pub level_ends: [u32; MAX_LEVELS - 1],
    /// Radius of the fit around a place, metres, positive.
    pub kernel_radius: f32,
    /// Digest of the rounded points in order.
    pub digest: u64,
}

/// An instance of a `surface` stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub struct MemberEntry {
    /// Index of its point set.
    pub set: u32,
    /// Features that it needs.
    pub needs: Needs,
}

/// A batch of point sets.
#[derive(Clone, Debug, PartialEq, Encode, Decode)]
pub struct SetBatch {
    /// Index of the first entry. Earlier batches hold the entries before it.
    pub first: u32,
    /// The entries, 1 to [`MAX_BATCH`].
    pub entries: Vec<SetEntry>,
}

/// A batch of instances.
#[derive(Clone, Debug, PartialEq, Eq, Encode, Decode)]
pub struct MemberBatch {
    /// Index of the first entry. Earlier batches hold the entries before it.
    pub first: u32,
    /// The entries, 1 to [`MAX_BATCH`].
    pub entries: Vec<MemberEntry>,
}

impl From<&SetLayout> for SetEntry {
    fn from(set: &SetLayout) -> Self {
        let SetLayout { origin, step, extent, normal_bits, points, charts, levels, kernel_radius, digest } =
            *set;
        let mut level_ends = [0; MAX_LEVELS - 1];
        level_ends[..levels.ends().len()].copy_from_slice(levels.ends());
        Self {
            origin,
            step,
            extent,
            normal_bits,
            points,
            charts,
            levels: levels.count(),
            level_ends,
            kernel_radius,
            digest: digest.0,
        }
    }
}

impl From<&SetEntry> for SetLayout {
    fn from(entry: &SetEntry) -> Self {
        let SetEntry { origin, step, extent, normal_bits, points, charts, kernel_radius, digest, .. } =
            *entry;
        let (digest, levels) = (GeometryDigest(digest), entry.levels().unwrap_or_default());
        Self { origin, step, extent, normal_bits, points, charts, levels, kernel_radius, digest }
    }
}

impl SetBatch {
    pub(super) fn check(&self) -> Result<(), FieldError> {
        require((1..=MAX_BATCH).contains(&self.entries.len()), "entries", "must have 1 to 512 sets")?;
        self.entries.iter().try_for_each(SetEntry::check)
    }
}

impl MemberBatch {
    pub(super) fn check(&self) -> Result<(), FieldError> {
        require((1..=MAX_BATCH).contains(&self.entries.len()), "entries", "must have 1 to 512 instances")
    }
}

impl SetEntry {
    /// Returns the levels; `None` if the numbers make no sense.
    fn levels(&self) -> Option<Levels> {
        let coarser = usize::from(self.levels).checked_sub(1)?;
        let (ends, unused) = self.level_ends.split_at_checked(coarser)?;
        let fits = ends.iter().all(|end| *end <= self.points) && unused.iter().all(|end| *end == 0);
        Levels::from_ends(ends).filter(|_| fits)
    }

    fn check(&self) -> Result<(), FieldError> {
        let positive = |value: f32| value > 0.0 && value.is_finite();
        finite(&self.origin, "origin")?;
        require(positive(self.step), "step", "is not a positive number")?;
        require((2..=8).contains(&self.normal_bits), "normal_bits", "is not 2 to 8")?;
        require(self.charts <= MAX_CHARTS, "charts", "is more than 2^24")?;
        require(self.charts >= self.points.min(1), "charts", "is 0, but there are points")?;
        require(self.levels().is_some(), "levels", "are none, more than 12, or not in ascending order")?;
        require(positive(self.kernel_radius), "kernel_radius", "is not a positive number")
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::golden;
    use super::super::{Message, Scene};
    use super::*;

    const SET: SetEntry = SetEntry {
        origin: [-1.0, 0.0, 1.0],
        step: 0.5,
        extent: [4, 5, 6],
        normal_bits: 6,
        points: 9,
        charts: 2,
        levels: 3,
        level_ends: [2, 5, 0, 0, 0, 0, 0, 0, 0, 0, 0],
        kernel_radius: 0.25,
        digest: 0x0102_0304_0506_0708,
    };
    const MEMBER: MemberEntry = MemberEntry { set: 7, needs: Needs::SKIN.union(Needs::MASKED) };

    #[test]
    fn golden_bytes_of_sets() {
        golden(
            &Scene::Sets(SetBatch { first: 1, entries: vec![SET] }),
            "02000000 01000000 0100000000000000 000080bf 00000000 0000803f 0000003f 04000000 05000000 06000000 \
             06 09000000 02000000 03 02000000 05000000 000000000000000000000000000000000000000000000000 \
             000000000000000000000000 0000803e 0807060504030201",
        );
    }

    #[test]
    fn golden_bytes_of_members() {
        golden(
            &Scene::Members(MemberBatch { first: 2, entries: vec![MEMBER] }),
            "03000000 02000000 0100000000000000 07000000 11000000",
        );
    }

    #[test]
    fn full_batches_fit_a_message_and_longer_ones_do_not() {
        let sets = |count| Scene::Sets(SetBatch { first: 0, entries: vec![SET; count] });
        let members = |count| Scene::Members(MemberBatch { first: 0, entries: vec![MEMBER; count] });
        for full in [sets(MAX_BATCH), members(MAX_BATCH)] {
            assert_eq!(Scene::from_payload(&full.to_payload().unwrap()), Ok(full));
        }
        for bad in [sets(MAX_BATCH + 1), sets(0), members(MAX_BATCH + 1), members(0)] {
            assert!(bad.to_payload().is_err());
        }
        for full in [sets(MAX_BATCH), members(MAX_BATCH)] {
            let mut bytes = full.to_payload().unwrap();
            // A count of 2^64 - 1 entries must be refused before anything is allocated for it.
            bytes[8..16].copy_from_slice(&[0xff; 8]);
            assert!(Scene::from_payload(&bytes).is_err());
        }
    }

    #[test]
    fn sets_that_make_no_sense_are_refused() {
        for bad in [
            SetEntry { origin: [0.0, f32::NAN, 0.0], ..SET },
            SetEntry { step: 0.0, ..SET },
            SetEntry { normal_bits: 1, ..SET },
            SetEntry { normal_bits: 9, ..SET },
            SetEntry { charts: 0, ..SET },
            SetEntry { charts: (1 << 24) + 1, ..SET },
            SetEntry { levels: 0, ..SET },
            SetEntry { levels: 13, ..SET },
            SetEntry { levels: 2, ..SET },
            SetEntry { level_ends: [5, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0], ..SET },
            SetEntry { level_ends: [2, 10, 0, 0, 0, 0, 0, 0, 0, 0, 0], ..SET },
            SetEntry { kernel_radius: f32::INFINITY, ..SET },
        ] {
            let batch = SetBatch { first: 0, entries: vec![SET, bad] };
            assert!(Scene::Sets(batch).to_payload().is_err(), "{bad:?}");
        }
    }

    #[test]
    fn an_entry_and_the_codecs_layout_say_the_same() {
        assert_eq!(SetEntry::from(&SetLayout::from(&SET)), SET);
        assert_eq!(PointSource::from(GeometrySource::Sent), PointSource::SENT);
        assert_eq!(PointSource::from(GeometrySource::Shared).to_string(), "shared");
    }
}
