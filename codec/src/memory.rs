//! Counts heap memory from the sizes of collections. The result depends only on the word size, not on the allocator.

use bitvec::vec::BitVec;

/// Returns the bytes of a list's buffer. Heap memory of its elements is not included.
#[must_use]
pub fn list<T>(list: &Vec<T>) -> usize {
    list.capacity() * size_of::<T>()
}

/// Returns the bytes of the buffer of a list of bits.
pub(crate) fn bits(list: &BitVec) -> usize {
    list.capacity() / 8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn room_counts_used_or_not() {
        let mut some: Vec<u32> = Vec::with_capacity(9);
        some.push(1);
        assert_eq!(list(&some), some.capacity() * 4);
        assert_eq!(list(&Vec::<u64>::new()), 0);
    }
}
