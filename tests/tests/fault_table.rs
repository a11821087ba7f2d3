//! Every row of the fault table, done to real processes by `orime-evaluate faults`.

use orime_tests::{Scratch, run};
use serde_json::Value;
use std::fs;

/// Runs one row; it must pass, or say loudly what right it lacks.
fn row(number: u32) {
    let scratch = Scratch::new(&format!("fault-{number}"));
    let json = scratch.path("faults.json");
    let output = run("orime-evaluate", &["faults", "--rows", &number.to_string(), "--json", &json]);
    let text = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
    let table: Value =
        serde_json::from_str(&fs::read_to_string(&json).unwrap_or_else(|_| panic!("{text}")))
            .unwrap();
    let row = &table["rows"][0];
    assert_eq!((&row["row"], &table["failed"]), (&number.into(), &0.into()), "{text}");
    if row["result"] == "skipped" {
        eprintln!("SKIPPED fault {number}: {}", row["seen"]);
        return;
    }
    assert_eq!((&row["result"], &row["left_behind"]), (&"passed".into(), &0.into()), "{text}");
    assert!(row["recovery_ms"].as_f64().is_some(), "{text}");
}

macro_rules! rows {
    ($($name:ident = $number:literal),* $(,)?) => {
        $(#[test]
        fn $name() {
            row($number);
        })*

        #[test]
        fn no_row_is_forgotten() {
            assert_eq!([$($number),*], [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14]);
        }
    };
}

rows! {
    a_camera_is_unplugged = 1,
    a_subscriber_is_slow = 2,
    a_stage_is_killed_holding_a_loan = 3,
    single_stages_are_restarted = 4,
    a_stage_hangs_at_start = 5,
    the_supervisor_is_killed = 6,
    shared_memory_is_stale = 7,
    shared_memory_is_too_small = 8,
    the_config_is_wrong = 9,
    the_clock_is_set = 10,
    a_recording_is_damaged = 11,
    the_disk_is_full = 12,
    another_user_attaches = 13,
    versions_do_not_match = 14,
}
