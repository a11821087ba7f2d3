//! `orime-capture`: frames of a set's source, written in place. Each frame's story is in `lib.rs`.

mod service;

use orime_messages::Stage;
use orime_runtime::Beginning;

fn main() -> anyhow::Result<()> {
    service::Capture::open(Beginning::of(Stage::Capture)?)?.run()
}
