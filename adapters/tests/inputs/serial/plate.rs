//! Simulated AMTI plate at the far end of a line, minimal and by the protocol: it receives only at its own speed.

use super::pty::{Device, Socket};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

/// The frame of the published vectors: counts 0, 10, 20 … 110.
pub(crate) const FRAME: [u8; 24] = [
    0x00, 0x08, 0x0a, 0x18, 0x14, 0x28, 0x1e, 0x38, 0x28, 0x48, 0x32, 0x58, 0x3c, 0x68, 0x46, 0x78, 0x50,
    0x88, 0x5a, 0x98, 0x64, 0xa8, 0x6e, 0xb8,
];

/// The plate's output in place of each of its frames.
type Send = Box<dyn FnMut(u32) -> Vec<u8> + core::marker::Send>;

/// A plate in its own thread.
pub(crate) struct Plate {
    stop: Arc<AtomicBool>,
    received: Arc<Mutex<Vec<u8>>>,
    thread: Option<JoinHandle<()>>,
}

impl Plate {
    /// Connects and starts the plate.
    pub(crate) fn plug(socket: &Socket, mut send: Send) -> Plate {
        let (stop, received) = (Arc::new(AtomicBool::new(false)), Arc::new(Mutex::new(Vec::new())));
        let (stopping, receives) = (Arc::clone(&stop), Arc::clone(&received));
        let device = socket.plug();
        let thread = std::thread::spawn(move || {
            let (mut baud, mut streams, mut number) = (57_600, false, 0);
            while !stopping.load(Relaxed) {
                for byte in device.received() {
                    if device.speed() == baud {
                        receives.lock().unwrap().push(byte);
                        answer(byte, &device, &mut baud, &mut streams);
                    }
                }
                if streams && device.speed() == baud {
                    device.say(&send(number));
                    number += 1;
                }
                std::thread::sleep(Duration::from_millis(2));
            }
        });
        Plate { stop, received, thread: Some(thread) }
    }

    /// Bytes received at the plate's own speed.
    pub(crate) fn received(&self) -> Vec<u8> {
        self.received.lock().unwrap().clone()
    }

    pub(crate) fn unplug(self) {}
}

impl Drop for Plate {
    fn drop(&mut self) {
        self.stop.store(true, Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.join().unwrap();
        }
    }
}

fn answer(command: u8, device: &Device, baud: &mut u32, streams: &mut bool) {
    match command {
        0x52 => (*baud, *streams) = (57_600, false),
        0x51 => {
            device.say(&[0x55]);
            *streams = true;
        }
        0x66 | 0x72 | 0x76 => {
            device.say(&[command]);
            *baud = if command == 0x72 { 57_600 } else { 115_200 };
        }
        other => panic!("{other:#x} is no command"),
    }
}
