//! `orime layouts`: what the messages look like in memory, for programs in other languages.

use orime_messages::layout::{Layout, Shape};
use orime_messages::{
    FoldPlan, FrameMeta, Grippers, Message, ObservedCloud, PROTOCOL, SheetState, StageRecord,
    Targets, Truth,
};
use orime_runtime::channel;
use serde_json::{Map, Value, json};

use crate::exit::{Exit, Failure};

/// Prints the layouts of all messages as JSON.
pub fn layouts() -> Result<Exit, Failure> {
    let text = serde_json::to_string_pretty(&all())
        .map_err(|error| Failure::machine(error.to_string()))?;
    println!("{text}");
    Ok(Exit::Good)
}

fn all() -> Value {
    let mut structs = Map::new();
    let channels = json!({
        channel::CLOUD.name: message::<ObservedCloud>(&mut structs),
        channel::TARGETS.name: message::<Targets>(&mut structs),
        channel::STATE.name: message::<SheetState>(&mut structs),
        channel::TRUTH.name: message::<Truth>(&mut structs),
        channel::GRIPPER.name: message::<Grippers>(&mut structs),
        channel::PLAN.name: message::<FoldPlan>(&mut structs),
        channel::PREDICTION.name: message::<SheetState>(&mut structs),
        channel::RECORD.name: message::<StageRecord>(&mut structs),
    });
    let frame = json!({
        "channel": channel::FRAME.name,
        "user_header": message::<FrameMeta>(&mut structs),
    });
    json!({"protocol": PROTOCOL, "channels": channels, "frame": frame, "structs": structs})
}

fn message<M: Message + Layout>(structs: &mut Map<String, Value>) -> Value {
    json!({"type_name": M::TYPE_NAME, "struct": describe(&M::shape(), structs)})
}

/// A type's name: a scalar's, a struct's, or `[element, count]`; structs are put aside.
fn describe(shape: &Shape, structs: &mut Map<String, Value>) -> Value {
    match shape {
        Shape::Scalar(name) => json!(name),
        Shape::Array(element, count) => json!([describe(element, structs), count]),
        Shape::Struct { name, size, fields } => {
            let fields: Vec<Value> = fields
                .iter()
                .map(|field| {
                    let kind = describe(&field.shape, structs);
                    json!({"name": field.name, "offset": field.offset, "type": kind})
                })
                .collect();
            structs.insert((*name).to_owned(), json!({"size": size, "fields": fields}));
            json!(name)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_python_client_has_these_layouts() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../clients/python/orime_layouts.json");
        let shipped: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
        let remedy = "run: target/release/orime layouts > clients/python/orime_layouts.json";
        assert_eq!(shipped, all(), "{remedy}");
    }
}
