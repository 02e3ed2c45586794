//! A global allocator that counts what the armed threads ask of it. Each thread has a flag and counters of its own.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static ARMED: Cell<bool> = const { Cell::new(false) };
    static TOUCHED: Cell<Touched> = const { Cell::new(Touched { allocations: 0, frees: 0 }) };
}

/// How often a thread touched the heap while it was armed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Touched {
    pub(crate) allocations: u64,
    pub(crate) frees: u64,
}

/// From now on the calling thread's calls count, or no longer.
pub(crate) fn arm(armed: bool) {
    ARMED.set(armed);
}

/// What the calling thread did while it was armed.
pub(crate) fn touched() -> Touched {
    TOUCHED.get()
}

fn count(allocations: u64, frees: u64) {
    // A thread that is being torn down has no flag any more, and is not the loop.
    if ARMED.try_with(Cell::get).unwrap_or(false) {
        let Touched { allocations: a, frees: f } = TOUCHED.get();
        TOUCHED.set(Touched { allocations: a + allocations, frees: f + frees });
    }
}

struct Counting;

#[expect(unsafe_code, reason = "GlobalAlloc is an unsafe trait")]
// SAFETY: every call is handed on to the system allocator as it came; counting touches no heap.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(1, 0);
        // SAFETY: the caller keeps GlobalAlloc's contract, which is System's.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(1, 0);
        // SAFETY: as above.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(0, 1);
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(1, 1);
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;
