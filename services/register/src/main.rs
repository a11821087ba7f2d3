//! `orime-register`: clouds and states in, targets out. The registration's story is in `lib.rs`.

mod service;

use orime_messages::Stage;
use orime_runtime::Service;

fn main() -> anyhow::Result<()> {
    let service = Service::start(Stage::Register)?;
    service::Register::open(&service)?.run()
}
