//! How samples are taken together.

use magnetic_bearing::model::cells::{CELLS_PER_HOP, Cells};

#[test]
fn cells_make_up_every_window() {
    for intervals in (8..460).chain([1000, 1999, 2000, 20_000, 99_999, 100_000]) {
        let hop = (intervals / 25).max(1);
        let cells = Cells::new(intervals, hop);
        let sizes = cells.sizes();
        assert_eq!(sizes.iter().sum::<usize>(), intervals + 1, "N = {intervals}");
        assert_eq!([sizes[0], sizes[sizes.len() - 1]], [1, 1], "N = {intervals}");
        let most = (hop / CELLS_PER_HOP).max(1);
        assert!(sizes.iter().all(|size| (1..=most).contains(size)), "N = {intervals}: {sizes:?}");
        // What the next window no longer holds are whole cells, and the pattern goes on as it was.
        let leaving = cells.per_hop();
        assert_eq!(sizes[..leaving].iter().sum::<usize>(), hop, "N = {intervals}");
        assert!(sizes.iter().zip(&sizes[leaving..]).all(|(a, b)| a == b), "N = {intervals}: {sizes:?}");
        // A window ends with a hop.
        assert!(cells.ends(hop - 1));
        assert_eq!((0..hop).filter(|sample| cells.ends(*sample)).count(), leaving);
    }
}

/// The work on cells is bounded, whatever the window.
#[test]
fn there_are_few_cells() {
    for intervals in (8..5000).chain([20_000, 99_999, 100_000]) {
        let count = Cells::new(intervals, (intervals / 25).max(1)).sizes().len();
        assert!(count <= 260, "N = {intervals}: {count} cells");
    }
    let alone = Cells::new(199, 7);
    assert!(alone.sizes().iter().all(|size| *size == 1));
}
