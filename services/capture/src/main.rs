//! `orime-capture`: frames of a set's source, written in place. Each frame's story is in `lib.rs`.

mod service;

use orime_messages::Stage;
use orime_runtime::Service;

fn main() -> anyhow::Result<()> {
    let service = Service::start(Stage::Capture)?;
    service::Capture::open(&service)?.run()
}
