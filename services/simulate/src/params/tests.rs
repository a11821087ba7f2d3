use super::*;

#[test]
fn defaults_pass_and_nonsense_is_reported_whole() {
    assert!(SimulateParams::default().check().is_ok());
    let bad = SimulateParams {
        substeps: 0,
        effects: vec![Effect::Stretch, Effect::Stretch],
        damping: DampingParams { time_s: f64::NAN, ..DampingParams::default() },
        track: TrackParams { frequency_hz: -1.0, ..TrackParams::default() },
        ..SimulateParams::default()
    };
    let keys: Vec<String> = bad.check().unwrap_err().into_iter().map(|p| p.key).collect();
    assert_eq!(keys, ["effects", "substeps", "damping.time_s", "track.frequency_hz"]);
}

#[test]
fn damping_as_printed_is_refused_where_it_diverges() {
    let keys = |kind, time_s| {
        let damping = DampingParams { kind, time_s };
        let params = SimulateParams { damping, ..SimulateParams::default() };
        params.check().err().unwrap_or_default().into_iter().map(|p| p.key).collect::<Vec<_>>()
    };
    assert_eq!(keys(DampingKind::Paper, 0.001), ["damping.time_s"]);
    assert!(keys(DampingKind::Paper, 0.0008).is_empty());
    assert!(keys(DampingKind::Xpbd, 0.001).is_empty());
}

#[test]
fn a_section_names_its_effects() {
    let text = "effects = [\"stretch\", \"air_drag\"]\n[air_drag]\nper_s = 3.0\n";
    let params: SimulateParams = toml::from_str(text).unwrap();
    assert_eq!(params.effects, [Effect::Stretch, Effect::AirDrag]);
    assert_eq!(params.air_drag.per_s, 3.0);
    assert!(toml::from_str::<SimulateParams>("effects = [\"wind\"]").is_err());
}
