//! Arrays of numbers, element by element. The generic models call these functions in hundreds of places; those of the standard library, which
//! provide for elements to be dropped if one panics, compile more slowly. Elements that are not `Copy` need `std::array::from_fn`.

/// The values of a function of the index, in order.
#[inline]
pub(crate) fn from_fn<T: Copy, const N: usize, F: FnMut(usize) -> T>(mut f: F) -> [T; N] {
    const { assert!(N > 0, "the first element fills the array") }
    let mut values = [f(0); N];
    let mut k = 1;
    while k < N {
        values[k] = f(k);
        k += 1;
    }
    values
}

/// The values of a function of each element.
#[inline]
pub(crate) fn map<T: Copy, U: Copy, const N: usize>(of: [T; N], mut f: impl FnMut(T) -> U) -> [U; N] {
    from_fn(|k| f(of[k]))
}

/// Combines two arrays element by element.
#[inline]
pub(crate) fn each<T: Copy, U: Copy, V: Copy, const N: usize>(a: &[T; N], b: &[U; N], f: impl Fn(T, U) -> V) -> [V; N] {
    from_fn(|k| f(a[k], b[k]))
}
