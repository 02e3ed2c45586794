//! A global allocator that counts the calls of armed threads. Each thread has its own flag and counters.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static ARMED: Cell<bool> = const { Cell::new(false) };
    static TOUCHED: Cell<Touched> = const { Cell::new(Touched { allocations: 0, frees: 0 }) };
}

/// Heap calls of a thread while it was armed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Touched {
    pub(crate) allocations: u64,
    pub(crate) frees: u64,
}

/// Starts or stops counting the calling thread's calls.
pub(crate) fn arm(armed: bool) {
    ARMED.set(armed);
}

/// Counts of the calling thread while it was armed.
pub(crate) fn touched() -> Touched {
    TOUCHED.get()
}

fn count(allocations: u64, frees: u64) {
    // A thread during its teardown has no flag any more, and is not the loop.
    if ARMED.try_with(Cell::get).unwrap_or(false) {
        let Touched { allocations: a, frees: f } = TOUCHED.get();
        TOUCHED.set(Touched { allocations: a + allocations, frees: f + frees });
    }
}

struct Counting;

#[expect(unsafe_code, reason = "GlobalAlloc is an unsafe trait")]
// SAFETY: every call is forwarded unchanged to the system allocator; counting does not use the heap.
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
