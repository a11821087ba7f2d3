//! Where the keys of a TOML text are.

use std::ops::Range;

use toml_edit::{Document, Item, TableLike};

/// One key: its dotted path, its own bytes, and those of its value (a table's header).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// Dotted path from the top; elements of arrays are numbered from 0.
    pub key: String,
    /// The key.
    pub key_span: Range<usize>,
    /// The value, or the header of a table.
    pub value_span: Range<usize>,
    /// Whether it is a table with a header of its own.
    pub is_table: bool,
}

/// Every key of a text, parents before children; empty if the text is not TOML.
pub fn places(text: &str) -> Vec<Place> {
    let mut found = Vec::new();
    if let Ok(document) = Document::parse(text) {
        walk(document.as_table(), "", &mut found);
    }
    found
}

/// The place of the deepest ancestor of `key`, itself included, that the text has.
pub fn nearest<'p>(places: &'p [Place], key: &str) -> Option<&'p Place> {
    places.iter().filter(|place| is_within(key, &place.key)).max_by_key(|place| place.key.len())
}

/// Whether `key` is `ancestor` or lies in it.
pub fn is_within(key: &str, ancestor: &str) -> bool {
    key.strip_prefix(ancestor).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
}

fn walk(table: &dyn TableLike, prefix: &str, found: &mut Vec<Place>) {
    for (name, item) in table.iter() {
        let key = if prefix.is_empty() { name.to_owned() } else { format!("{prefix}.{name}") };
        let own = table.key(name).and_then(|key| key.span());
        let value_span = item.span().or_else(|| own.clone());
        if let (Some(key_span), Some(value_span)) = (own, value_span) {
            let is_table = match item {
                Item::Table(table) => !table.is_dotted(),
                Item::ArrayOfTables(_) => true,
                _ => false,
            };
            // Of an array of tables, the elements' headers are places of their own.
            let value_span = if item.is_array_of_tables() { key_span.clone() } else { value_span };
            found.push(Place { key: key.clone(), key_span, value_span, is_table });
        }
        descend(item, &key, found);
    }
}

fn descend(item: &Item, key: &str, found: &mut Vec<Place>) {
    if let Some(table) = item.as_table_like() {
        walk(table, key, found);
    } else if let Some(tables) = item.as_array_of_tables() {
        for (k, table) in tables.iter().enumerate() {
            element(table.span(), &format!("{key}.{k}"), true, found);
            walk(table, &format!("{key}.{k}"), found);
        }
    } else if let Some(values) = item.as_array() {
        for (k, value) in values.iter().enumerate() {
            element(value.span(), &format!("{key}.{k}"), false, found);
            if let Some(table) = value.as_inline_table() {
                walk(table, &format!("{key}.{k}"), found);
            }
        }
    }
}

fn element(span: Option<Range<usize>>, key: &str, is_table: bool, found: &mut Vec<Place>) {
    if let Some(span) = span {
        let key = key.to_owned();
        found.push(Place { key, key_span: span.clone(), value_span: span, is_table });
    }
}
