//! The loop's step with nothing beneath it: no std, no heap, no operating system.
//!
//! A machine without an operating system has its own Rust target, but the same is proved on any. If a
//! dependency of the core linked std, its panic handler would collide with the one below. Heap use shows when the
//! step is linked: the allocator below calls an undefined function, so that the link fails as soon as anything
//! reachable from [`equipoise_step`] allocates or frees. (Having no allocator at all would be simpler, but
//! iceoryx2's trait crate names the `alloc` crate, though none of what the core takes from it uses it.)
#![no_std]

#[cfg(feature = "break_with_heap")]
extern crate alloc;
#[cfg(feature = "break_with_std")]
extern crate std;

use core::alloc::{GlobalAlloc, Layout};
use core::panic::PanicInfo;

use equipoise_core::cycle::{self, Inputs, Memory, Settings, Tick};
use equipoise_core::message::{GroundSample, State, SuitSample};

/// Puts a memory back to the state before the first sample.
#[unsafe(no_mangle)]
pub extern "C" fn equipoise_start(settings: &Settings, memory: &mut Memory) {
    memory.start(settings);
}

/// One step with at most one sample of each stream; the newest state is in `state` afterwards.
#[unsafe(no_mangle)]
pub extern "C" fn equipoise_step(
    settings: &Settings,
    memory: &mut Memory,
    due_ns: u64,
    suit: Option<&SuitSample>,
    ground: Option<&GroundSample>,
    state: &mut State,
) {
    let tick = Tick { cycle: state.cycle + 1, due_ns };
    let inputs = Inputs {
        suit: suit.map_or(&[], core::slice::from_ref),
        ground: ground.map_or(&[], core::slice::from_ref),
        body: None,
        command: None,
    };
    *state = *cycle::step(settings, memory, tick, inputs);
    #[cfg(feature = "break_with_heap")]
    core::hint::black_box(alloc::boxed::Box::new(due_ns));
}

unsafe extern "C" {
    /// Defined nowhere.
    fn the_core_uses_the_heap() -> *mut u8;
}

struct NoHeap;

// SAFETY: never runs, since a program that could reach it cannot be linked.
unsafe impl GlobalAlloc for NoHeap {
    unsafe fn alloc(&self, _: Layout) -> *mut u8 {
        // SAFETY: as above.
        unsafe { the_core_uses_the_heap() }
    }

    unsafe fn dealloc(&self, _: *mut u8, _: Layout) {
        // SAFETY: as above.
        unsafe { the_core_uses_the_heap() };
    }
}

#[global_allocator]
static NO_HEAP: NoHeap = NoHeap;

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    loop {}
}
