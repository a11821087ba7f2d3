//! `orime-segment`: frame sets in, observed clouds out. The pixels' story is in `lib.rs`.

mod service;

use orime_messages::Stage;
use orime_runtime::Service;

fn main() -> anyhow::Result<()> {
    let service = Service::start(Stage::Segment)?;
    service::Segment::open(&service)?.run()
}
