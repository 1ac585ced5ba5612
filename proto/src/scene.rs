//! The scene table: what both ends know before the first keyframe.

use std::sync::Arc;

use psao_codec::Layout;
use psao_codec::paper::{self, PointFormat};
use psao_codec::surface::{self, Member, SetLayout};

use crate::message::{
    InstanceBatch, InstanceEntry, MAX_BATCH, MemberBatch, MemberEntry, Message, MessageError, Needs, Scene,
    SceneHeader, SetBatch, SetEntry,
};
use crate::{Limits, Profile};

mod info;

use info::Counts;
pub use info::{PaperInfo, SceneInfo, TraceInfo};

/// Why SCENE messages do not form a scene table.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// Entries came before the header, or in the wrong order.
    #[error("SCENE frames are out of order: expected {expected}")]
    Order {
        /// The expected content.
        expected: &'static str,
    },
    /// A batch does not follow the one before it.
    #[error("SCENE frames are out of order: {what} from {found} on, expected those from {expected} on")]
    Batch {
        /// Content of the batch.
        what: &'static str,
        /// Number of earlier entries.
        expected: u32,
        /// Index of the batch's first entry.
        found: u32,
    },
    /// The number of instances or sets is not the announced one, or over the limit.
    #[error("the scene has {found} {what}, expected at most {expected}")]
    Count {
        /// The counted item.
        what: &'static str,
        /// The announced or allowed number.
        expected: u32,
        /// The number found.
        found: u64,
    },
    /// The points of the instances do not add up to the announced number.
    #[error("the instances have {found} points in all, {expected} were announced")]
    Points {
        /// The announced number.
        expected: u32,
        /// Sum of the instances.
        found: u64,
    },
    /// The profile is unknown, or the entries belong to another one.
    #[error("the scene table is of profile {found}, of which this version knows no such entries")]
    Profile {
        /// The profile announced.
        found: Profile,
    },
    /// The header of a `paper` stream lacks the sizes of its tables.
    #[error("a stream of profile paper needs SceneInfo::paper")]
    NoPaperInfo,
    /// No packing of this width is known.
    #[error("points of {found} bits: this version knows 32, 24 and 16")]
    PointBits {
        /// The announced number.
        found: u8,
    },
    /// The grid of an instance is invalid.
    #[error("instance {instance}: {source}")]
    Grid {
        /// Index of the instance.
        instance: u32,
        /// The problem.
        source: paper::GridError,
    },
    /// The instances form no valid layout of profile `paper`, or one over the limits.
    #[error(transparent)]
    Cells(#[from] paper::LayoutError),
    /// The sets and instances form no valid layout of profile `surface`, or one over the limits.
    #[error(transparent)]
    Surface(#[from] surface::LayoutError),
    /// A message is invalid by itself.
    #[error(transparent)]
    Message(#[from] MessageError),
}

/// The entries of a scene table.
#[derive(Clone, Debug, PartialEq)]
pub enum SceneEntries {
    /// Profile `paper`: the instances.
    Cells(Vec<InstanceEntry>),
    /// Profile `surface`.
    Surface {
        /// The point sets.
        sets: Vec<SetEntry>,
        /// The instances.
        members: Vec<MemberEntry>,
    },
}

impl SceneEntries {
    /// Returns an empty list of the entries of a profile.
    fn none(profile: Profile) -> Result<Self, SceneError> {
        match profile {
            Profile::PAPER => Ok(Self::Cells(Vec::new())),
            Profile::SURFACE => Ok(Self::Surface { sets: Vec::new(), members: Vec::new() }),
            found => Err(SceneError::Profile { found }),
        }
    }

    /// Returns the profile that has these entries.
    #[must_use]
    pub const fn profile(&self) -> Profile {
        match self {
            Self::Cells(_) => Profile::PAPER,
            Self::Surface { .. } => Profile::SURFACE,
        }
    }

    /// Instances and sets.
    fn counts(&self) -> (usize, usize) {
        match self {
            Self::Cells(instances) => (instances.len(), 0),
            Self::Surface { sets, members } => (members.len(), sets.len()),
        }
    }

    /// Points of all instances.
    fn points(&self) -> u64 {
        match self {
            Self::Cells(instances) => instances.iter().map(|entry| u64::from(entry.points)).sum(),
            Self::Surface { sets, members } => {
                let points = |member: &MemberEntry| sets.get(member.set as usize).map_or(0, |set| set.points);
                members.iter().map(|member| u64::from(points(member))).sum()
            }
        }
    }

    fn layout(&self, info: &SceneInfo, limits: &Limits) -> Result<Layout, SceneError> {
        match self {
            Self::Cells(instances) => cells_layout(instances, info, limits),
            Self::Surface { sets, members } => {
                let sets = sets.iter().map(SetLayout::from).collect();
                let members = members.iter().map(|member| Member { set: member.set }).collect();
                let layout = surface::Layout::new(sets, members, &limits.codec)?;
                Ok(Layout::Surface(Arc::new(layout)))
            }
        }
    }
}

fn cells_layout(
    instances: &[InstanceEntry],
    info: &SceneInfo,
    limits: &Limits,
) -> Result<Layout, SceneError> {
    let PaperInfo { cell_capacity, .. } = info.paper.ok_or(SceneError::NoPaperInfo)?;
    let format =
        PointFormat::from_bits(info.point_bits).ok_or(SceneError::PointBits { found: info.point_bits })?;
    let grid = |(instance, entry): (u32, &InstanceEntry)| {
        let grid = paper::Grid::new(entry.origin, entry.edge, entry.dims)
            .map_err(|source| SceneError::Grid { instance, source })?;
        let &InstanceEntry { first_bucket, bucket_count, kernel_radius, .. } = entry;
        Ok(paper::InstanceLayout { grid, first_bucket, bucket_count, kernel_radius })
    };
    let layouts = (0u32..).zip(instances).map(grid).collect::<Result<Vec<_>, SceneError>>()?;
    Ok(Layout::Paper(Arc::new(paper::Layout::new(format, layouts, cell_capacity, &limits.codec)?)))
}

/// A checked scene table and the codec's layout made from it.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneTable {
    info: SceneInfo,
    counts: Counts,
    entries: SceneEntries,
    layout: Layout,
}

impl SceneTable {
    /// Creates a table from its facts and entries, which give it its profile and its counts.
    ///
    /// # Errors
    /// [`SceneError`] when grids, buckets or sets do not fit each other, the facts or `limits`.
    #[expect(clippy::needless_pass_by_value, reason = "the table takes the facts over")]
    pub fn new(info: SceneInfo, entries: SceneEntries, limits: &Limits) -> Result<Self, SceneError> {
        let layout = entries.layout(&info, limits)?;
        let found = entries.points();
        let points = u32::try_from(found).map_err(|_| SceneError::Points { expected: u32::MAX, found })?;
        let (instances, sets) = entries.counts();
        let (instances, sets) = (instances as u32, sets as u32);
        let counts = Counts { profile: entries.profile(), sets, instances, points };
        // Facts that equal the neutral values are treated as absent, as a client does.
        let info = info.header(counts).into();
        Ok(Self { info, counts, entries, layout })
    }

    /// Creates a table from its messages, and checks the counts that the first one announced.
    fn announced(header: SceneHeader, entries: SceneEntries, limits: &Limits) -> Result<Self, SceneError> {
        let (instances, sets) = entries.counts();
        for (what, expected, found) in
            [("instances", header.instance_count, instances), ("point sets", header.set_count, sets)]
        {
            if found as u64 != u64::from(expected) {
                return Err(SceneError::Count { what, expected, found: found as u64 });
            }
        }
        if header.profile != entries.profile() {
            return Err(SceneError::Profile { found: header.profile });
        }
        let expected = header.point_count;
        let table = Self::new(header.into(), entries, limits)?;
        if table.point_count() != expected {
            return Err(SceneError::Points { expected, found: table.point_count().into() });
        }
        Ok(table)
    }

    /// Returns the facts about the stream as a whole.
    #[must_use]
    pub const fn info(&self) -> &SceneInfo {
        &self.info
    }

    /// Returns the stream's profile.
    #[must_use]
    pub const fn profile(&self) -> Profile {
        self.counts.profile
    }

    /// Returns the number of instances.
    #[must_use]
    pub const fn instance_count(&self) -> u32 {
        self.counts.instances
    }

    /// Returns the number of point sets; 0 in profile `paper`.
    #[must_use]
    pub const fn set_count(&self) -> u32 {
        self.counts.sets
    }

    /// Returns the number of points of all instances.
    #[must_use]
    pub const fn point_count(&self) -> u32 {
        self.counts.points
    }

    /// Returns the first SCENE message: facts and counts as they are on the wire.
    #[must_use]
    pub fn header(&self) -> SceneHeader {
        self.info.header(self.counts)
    }

    /// Returns the entries.
    #[must_use]
    pub const fn entries(&self) -> &SceneEntries {
        &self.entries
    }

    /// Returns what each instance needs, by index.
    #[must_use]
    pub fn needs(&self) -> Vec<Needs> {
        match &self.entries {
            SceneEntries::Cells(instances) => instances.iter().map(|entry| entry.needs).collect(),
            SceneEntries::Surface { members, .. } => members.iter().map(|entry| entry.needs).collect(),
        }
    }

    /// Returns the layout of the stream's state.
    #[must_use]
    pub const fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Returns the payloads of the SCENE frames that carry this table, in order.
    ///
    /// # Errors
    /// [`MessageError::Invalid`] when a value is invalid.
    pub fn payloads(&self) -> Result<Vec<Vec<u8>>, MessageError> {
        let mut scenes = vec![Scene::Info(self.header())];
        match &self.entries {
            SceneEntries::Cells(instances) => scenes.extend(batches(instances, |first, entries| {
                Scene::Instances(InstanceBatch { first, entries })
            })),
            SceneEntries::Surface { sets, members } => {
                scenes.extend(batches(sets, |first, entries| Scene::Sets(SetBatch { first, entries })));
                scenes.extend(batches(members, |first, entries| {
                    Scene::Members(MemberBatch { first, entries })
                }));
            }
        }
        scenes.iter().map(Message::to_payload).collect()
    }
}

/// Splits entries into batches that fit a message.
fn batches<T: Copy>(entries: &[T], batch: impl Fn(u32, Vec<T>) -> Scene) -> Vec<Scene> {
    let firsts = (0u32..).step_by(MAX_BATCH);
    firsts.zip(entries.chunks(MAX_BATCH)).map(|(first, entries)| batch(first, entries.to_vec())).collect()
}

/// Assembles a scene table from SCENE messages.
#[derive(Clone, Debug, Default)]
pub(crate) struct SceneAssembler {
    begun: Option<(SceneHeader, SceneEntries)>,
}

impl SceneAssembler {
    /// Takes the next message. A header starts a new table, because damage in a recording may have cut off an earlier
    /// one.
    pub(crate) fn push_or_restart(
        &mut self,
        scene: Scene,
        limits: &Limits,
    ) -> Result<Option<SceneTable>, SceneError> {
        if matches!(scene, Scene::Info(_)) {
            *self = Self::default();
        }
        self.push(scene, limits)
    }

    /// Takes the next message. Returns the table once it is complete.
    pub(crate) fn push(&mut self, scene: Scene, limits: &Limits) -> Result<Option<SceneTable>, SceneError> {
        match (scene, &mut self.begun) {
            (Scene::Info(header), None) => {
                check_counts(&header, limits)?;
                let entries = SceneEntries::none(header.profile)?;
                self.begun = Some((header, entries));
            }
            (_, None) => return Err(SceneError::Order { expected: "the scene's info" }),
            (scene, Some((header, entries))) => add(scene, header, entries)?,
        }
        let whole = |(header, entries): &mut (SceneHeader, SceneEntries)| {
            entries.counts() == (header.instance_count as usize, header.set_count as usize)
        };
        match self.begun.take_if(whole) {
            Some((header, entries)) => SceneTable::announced(header, entries, limits).map(Some),
            None => Ok(None),
        }
    }
}

/// Checks the announced counts before anything is stored.
fn check_counts(header: &SceneHeader, limits: &Limits) -> Result<(), SceneError> {
    let most = limits.codec.max_instances;
    for (what, found, expected) in [
        ("instances", header.instance_count, most),
        ("point sets", header.set_count, if header.profile == Profile::SURFACE { most } else { 0 }),
    ] {
        if found > expected {
            return Err(SceneError::Count { what, expected, found: found.into() });
        }
    }
    Ok(())
}

/// Adds a batch to the entries that came before it.
fn add(scene: Scene, header: &SceneHeader, entries: &mut SceneEntries) -> Result<(), SceneError> {
    match (scene, entries) {
        (Scene::Instances(batch), SceneEntries::Cells(instances)) => {
            extend("instances", instances, batch.first, &batch.entries, header.instance_count)
        }
        (Scene::Sets(batch), SceneEntries::Surface { sets, members }) if members.is_empty() => {
            extend("point sets", sets, batch.first, &batch.entries, header.set_count)
        }
        (Scene::Members(batch), SceneEntries::Surface { sets, members })
            if sets.len() == header.set_count as usize =>
        {
            extend("instances", members, batch.first, &batch.entries, header.instance_count)
        }
        (_, SceneEntries::Cells(_)) => Err(SceneError::Order { expected: "instances" }),
        (_, SceneEntries::Surface { .. }) => {
            Err(SceneError::Order { expected: "point sets, then their instances" })
        }
    }
}

/// Adds a batch to its list, which may have `most` entries.
fn extend<T: Copy>(
    what: &'static str,
    list: &mut Vec<T>,
    first: u32,
    batch: &[T],
    most: u32,
) -> Result<(), SceneError> {
    let expected = list.len() as u32;
    if first != expected {
        return Err(SceneError::Batch { what, expected, found: first });
    }
    let found = list.len() as u64 + batch.len() as u64;
    if found > u64::from(most) {
        return Err(SceneError::Count { what, expected: most, found });
    }
    list.extend_from_slice(batch);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::SampleServer;

    /// Returns tables of both profiles, with more entries than fit one batch.
    fn tables() -> [SceneTable; 2] {
        let count = MAX_BATCH as u32 + 3;
        let mut tables = Vec::new();
        for profile in [Profile::PAPER, Profile::SURFACE] {
            let sample = SampleServer::of(profile).unwrap().scene().as_ref().clone();
            let mut entries = sample.entries;
            match &mut entries {
                SceneEntries::Cells(instances) => {
                    let entry = instances[0];
                    let at = |first_bucket| InstanceEntry { first_bucket, bucket_count: 1, ..entry };
                    *instances = (0..count).map(at).collect();
                }
                SceneEntries::Surface { sets, members } => {
                    *members = (0..count).map(|set| MemberEntry { set, ..members[0] }).collect();
                    *sets = vec![sets[0]; count as usize];
                }
            }
            tables.push(SceneTable::new(sample.info, entries, &Limits::default()).unwrap());
        }
        tables.try_into().unwrap()
    }

    fn scenes(table: &SceneTable) -> Vec<Scene> {
        table.payloads().unwrap().iter().map(|payload| Scene::from_payload(payload).unwrap()).collect()
    }

    #[test]
    fn a_table_is_put_together_from_its_messages() {
        for table in tables() {
            let scenes = scenes(&table);
            let mut assembler = SceneAssembler::default();
            for (index, scene) in scenes.iter().enumerate() {
                let made = assembler.push(scene.clone(), &Limits::default()).unwrap();
                let expected = (index + 1 == scenes.len()).then_some(&table);
                assert_eq!(made.as_ref(), expected, "message {index}");
            }
            assert_eq!(table.needs().len(), table.layout().instances());
        }
    }

    #[test]
    fn messages_that_are_missing_or_swapped_are_refused() {
        for table in tables() {
            let scenes = scenes(&table);
            for left_out in 0..scenes.len() - 1 {
                let mut assembler = SceneAssembler::default();
                let mut rest = (0..scenes.len()).filter(|index| *index != left_out);
                let refused = rest.any(|i| assembler.push(scenes[i].clone(), &Limits::default()).is_err());
                assert!(refused, "without message {left_out} of {}", scenes.len());
            }
        }
    }

    #[test]
    fn counts_are_checked_against_the_limits_before_anything_is_kept() {
        for table in tables() {
            let mut limits = Limits::default();
            limits.codec.max_instances = table.instance_count() - 1;
            let refused = SceneAssembler::default().push(scenes(&table)[0].clone(), &limits);
            assert!(matches!(refused, Err(SceneError::Count { .. })), "{refused:?}");
        }
        let [_, surface] = tables();
        let mut limits = Limits::default();
        limits.codec.max_points = surface.point_count() - 1;
        let refused = SceneTable::new(surface.info, surface.entries, &limits);
        assert!(matches!(refused, Err(SceneError::Surface(surface::LayoutError::Points { .. }))));
    }

    #[test]
    fn the_width_of_the_points_makes_the_layout() {
        let [paper, _] = tables();
        let table = |point_bits| {
            let info = SceneInfo { point_bits, ..paper.info.clone() };
            SceneTable::new(info, paper.entries.clone(), &Limits::default())
        };
        for format in PointFormat::ALL {
            let table = table(format.bits() as u8).unwrap();
            assert_eq!(table.layout().as_paper().map(|layout| layout.format()), Some(format));
        }
        for found in [0, 8, 31, 64] {
            assert_eq!(table(found), Err(SceneError::PointBits { found }));
        }
    }

    #[test]
    fn entries_must_be_those_of_the_profile_and_add_up() {
        let [paper, surface] = tables();
        let new = |header, entries: &SceneEntries| {
            SceneTable::announced(header, entries.clone(), &Limits::default())
        };
        let other = SceneHeader { set_count: 0, ..surface.header() };
        assert!(matches!(new(other, &paper.entries), Err(SceneError::Profile { .. })));
        let unknown = SceneHeader { profile: Profile(9), ..paper.header() };
        let refused = SceneAssembler::default().push(Scene::Info(unknown), &Limits::default());
        assert_eq!(refused, Err(SceneError::Profile { found: Profile(9) }));
        for table in [&paper, &surface] {
            assert_eq!(new(table.header(), &table.entries).as_ref(), Ok(table));
            let header = SceneHeader { point_count: table.point_count() + 1, ..table.header() };
            assert!(matches!(new(header, &table.entries), Err(SceneError::Points { .. })));
            let header = SceneHeader { instance_count: 1, ..table.header() };
            assert!(matches!(new(header, &table.entries), Err(SceneError::Count { what: "instances", .. })));
        }
        let header = SceneHeader { set_count: 1, ..surface.header() };
        assert!(matches!(new(header, &surface.entries), Err(SceneError::Count { what: "point sets", .. })));
        let info = SceneInfo { paper: None, ..paper.info };
        let refused = SceneTable::new(info, paper.entries, &Limits::default());
        assert_eq!(refused, Err(SceneError::NoPaperInfo));
    }
}
