//! `orime-simulate`: targets in, sheet states out. The sheet's story is in `lib.rs`.

mod between;
mod service;

use orime_messages::Stage;
use orime_runtime::Service;

fn main() -> anyhow::Result<()> {
    let service = Service::start(Stage::Simulate)?;
    service::Simulate::open(&service)?.run()
}
