//! Tec Gihan's controller with one plate or two, on a serial line.

use std::collections::VecDeque;
use std::io;

use super::felt::{Felt, Mounting};
use super::line::Line;
use super::{Asked, Device, Suffered};
use crate::faults::Faults;
use crate::wires::tec_gihan::{BAUD, Dialogue, PlateInfo, block};

/// Blocks that the controller buffers for a host that is late with its request.
const KEPT: usize = 10;

/// The controller.
pub struct TecGihan {
    line: Line,
    dialogue: Dialogue,
    mounting: Mounting,
    /// The block that is being filled: plate, sample, channel.
    filling: Vec<Vec<[i16; 6]>>,
    ready: VecDeque<Vec<u8>>,
}

impl TecGihan {
    /// A controller with plates of the same kind.
    pub fn new(mut line: Line, plates: usize, mounting: Mounting) -> TecGihan {
        line.port().set_baud(BAUD);
        let infos = (0..plates as u32)
            .map(|index| PlateInfo::new(106 + index, -mounting.plate.surface_height_m))
            .collect();
        let dialogue = Dialogue::new(infos);
        TecGihan { line, dialogue, mounting, filling: vec![Vec::new(); plates], ready: VecDeque::new() }
    }

    fn send_what_is_owed(&mut self) -> io::Result<()> {
        while self.dialogue.owed > 0 {
            let Some(bytes) = self.ready.pop_front() else { break };
            self.dialogue.owed -= 1;
            self.line.send(&bytes, self.dialogue.samples_of_a_block() as u32)?;
        }
        Ok(())
    }
}

impl Device for TecGihan {
    fn poll(&mut self, _device_now_s: f64) -> io::Result<Asked> {
        let (zeroed, state) = (self.dialogue.zeroed, self.dialogue.state);
        for byte in self.line.port().hear()? {
            if let Some(answer) = self.dialogue.hear(byte) {
                self.line.answer(answer.as_bytes())?;
            }
        }
        if state != self.dialogue.state {
            self.ready.clear();
            self.filling.iter_mut().for_each(Vec::clear);
        }
        self.send_what_is_owed()?;
        Ok(Asked { zero: self.dialogue.zeroed != zeroed })
    }

    fn rate_hz(&self) -> f64 {
        self.dialogue.rate_hz()
    }

    fn measure(&mut self, felt: &Felt) -> io::Result<()> {
        if self.dialogue.state != crate::wires::tec_gihan::State::Measure {
            return Ok(());
        }
        let range = self.dialogue.range();
        for ((filling, info), wrench) in self.filling.iter_mut().zip(&self.dialogue.plates).zip(&felt.plates)
        {
            let [f, m] = [wrench.force_n, wrench.moment_nm];
            filling.push(info.counts(range, [f.x, f.y, f.z, m.x, m.y, m.z]));
        }
        if self.filling.iter().all(|plate| plate.len() >= self.dialogue.samples_of_a_block()) {
            self.ready.push_back(block(&self.filling));
            self.filling.iter_mut().for_each(Vec::clear);
            if self.ready.len() > KEPT {
                self.ready.pop_front();
            }
        }
        self.send_what_is_owed()
    }

    fn suffered(&self) -> Suffered {
        self.line.suffered()
    }

    fn set_faults(&mut self, faults: Faults) {
        self.line.set_faults(faults);
    }

    fn unplug(&mut self) {
        self.line.port().unplug();
    }

    fn plug(&mut self) -> io::Result<()> {
        self.dialogue = Dialogue::new(self.dialogue.plates.clone());
        self.ready.clear();
        self.filling.iter_mut().for_each(Vec::clear);
        self.line.port().plug()
    }

    fn config(&self) -> String {
        let [keys, sections] = self.line.config("ground");
        format!(
            "[ground]\nsource = \"tec-gihan\"\n{keys}{}\n{sections}\n[ground.tec_gihan]\nrate_hz = 2500\n",
            self.mounting.config("ground")
        )
    }
}
