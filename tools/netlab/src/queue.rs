//! What is to happen, by time.

use std::collections::BTreeMap;

use psao_proto::Micros;

/// Events by time; those of the same time in the order in which they were put in.
#[derive(Clone, Debug)]
pub(crate) struct Queue<T> {
    events: BTreeMap<(Micros, u64), T>,
    number: u64,
}

impl<T> Default for Queue<T> {
    fn default() -> Self {
        Self { events: BTreeMap::new(), number: 0 }
    }
}

impl<T> Queue<T> {
    pub(crate) fn push(&mut self, at: Micros, event: T) {
        self.events.insert((at, self.number), event);
        self.number += 1;
    }

    /// Returns the next event, if its time has come.
    pub(crate) fn pop(&mut self, now: Micros) -> Option<(Micros, T)> {
        let entry = self.events.first_entry().filter(|entry| entry.key().0 <= now)?;
        let ((at, _), event) = entry.remove_entry();
        Some((at, event))
    }

    /// When the next event is.
    pub(crate) fn next(&self) -> Option<Micros> {
        self.events.first_key_value().map(|((at, _), _)| *at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_come_by_time_then_by_order() {
        let mut queue = Queue::default();
        for (at, event) in [(5, 'c'), (3, 'a'), (5, 'd'), (3, 'b'), (9, 'e')] {
            queue.push(Micros(at), event);
        }
        assert_eq!((queue.pop(Micros(2)), queue.next()), (None, Some(Micros(3))));
        let all: String = std::iter::from_fn(|| queue.pop(Micros(8))).map(|(_, event)| event).collect();
        assert_eq!((all.as_str(), queue.next()), ("abcd", Some(Micros(9))));
    }
}
