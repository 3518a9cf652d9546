//! Frames: a header in JSON and arrays, with a checksum.

use std::collections::HashMap;

use serde::{Deserialize, Serialize};
use serde_json::{json, Value};

const MAGIC: &[u8; 4] = b"GMD1";
const LEAD: usize = 12;

/// Elements of an array, in C order.
pub enum Elements {
    Floats(Vec<f64>),
    Integers(Vec<i64>),
    /// Of a type that this service never asks for.
    Other,
}

pub struct Array {
    pub shape: Vec<usize>,
    pub elements: Elements,
}

impl Array {
    pub fn vectors(values: &[[f64; 2]]) -> Array {
        Array { shape: vec![values.len(), 2], elements: Elements::Floats(values.concat()) }
    }

    pub fn integers(values: &[i64]) -> Array {
        Array { shape: vec![values.len()], elements: Elements::Integers(values.to_vec()) }
    }
}

pub type Arrays = HashMap<String, Array>;

#[derive(Serialize, Deserialize)]
struct Info {
    name: String,
    dtype: String,
    shape: Vec<usize>,
}

#[derive(Deserialize)]
struct Header {
    message: Value,
    arrays: Vec<Info>,
}

/// Pack a message and its arrays into a frame.
pub fn encode(message: &Value, arrays: &[(&str, Array)]) -> Vec<u8> {
    let infos: Vec<Info> = arrays
        .iter()
        .map(|(name, array)| Info {
            name: name.to_string(),
            dtype: if matches!(array.elements, Elements::Integers(_)) { "<i8" } else { "<f8" }
                .into(),
            shape: array.shape.clone(),
        })
        .collect();
    let header = json!({"message": message, "arrays": infos}).to_string();
    let mut frame = Vec::from(MAGIC);
    frame.extend([0; 4]);
    frame.extend((header.len() as u32).to_le_bytes());
    frame.extend(header.as_bytes());
    pad(&mut frame);
    for (_, array) in arrays {
        match &array.elements {
            Elements::Floats(values) => frame.extend(values.iter().flat_map(|x| x.to_le_bytes())),
            Elements::Integers(values) => frame.extend(values.iter().flat_map(|i| i.to_le_bytes())),
            Elements::Other => unreachable!("only floats and integers are sent"),
        }
        pad(&mut frame);
    }
    let checksum = crc32fast::hash(&frame[8..]);
    frame[4..8].copy_from_slice(&checksum.to_le_bytes());
    frame
}

fn pad(frame: &mut Vec<u8>) {
    frame.resize(padded(frame.len()), 0);
}

fn padded(length: usize) -> usize {
    length.next_multiple_of(8)
}

/// Unpack a frame; the error says what is wrong with it.
pub fn decode(frame: &[u8]) -> Result<(Value, Arrays), String> {
    if frame.len() < LEAD || &frame[..4] != MAGIC {
        return Err("it is no gimpmd frame".into());
    }
    let word = |at: usize| u32::from_le_bytes(frame[at..at + 4].try_into().unwrap());
    if crc32fast::hash(&frame[8..]) != word(4) {
        return Err("its checksum is wrong".into());
    }
    let end = LEAD.saturating_add(word(8) as usize);
    let header = frame.get(LEAD..end).ok_or("it is too short for its header")?;
    let header: Header = serde_json::from_slice(header).map_err(|e| format!("its header: {e}"))?;
    let mut place = padded(end);
    let mut arrays = Arrays::new();
    for Info { name, dtype, shape } in header.arrays {
        let size = match dtype.as_str() {
            "<f8" | "<i8" => 8,
            "<f4" | "<i4" => 4,
            "|u1" | "|b1" => 1,
            _ => return Err(format!("array {name} has the unknown type {dtype}")),
        };
        let bytes = shape
            .iter()
            .try_fold(size, |product: usize, n| product.checked_mul(*n))
            .and_then(|length| frame.get(place..place.checked_add(length)?))
            .ok_or(format!("it is too short for its array {name}"))?;
        let words = bytes.chunks_exact(8).map(|word| word.try_into().unwrap());
        let elements = match dtype.as_str() {
            "<f8" => Elements::Floats(words.map(f64::from_le_bytes).collect()),
            "<i8" => Elements::Integers(words.map(i64::from_le_bytes).collect()),
            _ => Elements::Other,
        };
        place = padded(place + bytes.len());
        arrays.insert(name, Array { shape, elements });
    }
    Ok((header.message, arrays))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The example of protocol.md: its bytes are read there, not written again here.
    #[test]
    fn the_example_of_the_protocol_is_read() {
        let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../../schemas/protocol.md");
        let text = std::fs::read_to_string(page).unwrap();
        let dump = text.split("```hex\n").nth(1).unwrap().split("```").next().unwrap();
        let frame: Vec<u8> = dump
            .lines()
            .flat_map(|line| line[6..53].split_whitespace())
            .map(|byte| u8::from_str_radix(byte, 16).unwrap())
            .collect();
        let (message, arrays) = decode(&frame).unwrap();
        assert_eq!(message, json!({"type": "Payload", "role": "continuum", "rank": 0, "step": 7}));
        let Elements::Floats(velocity) = &arrays["velocity"].elements else { panic!() };
        assert_eq!(velocity, &[0.5, 0.0, -1.0, 0.25]);
        assert_eq!(arrays["velocity"].shape, [2, 2]);
    }

    #[test]
    fn what_is_packed_is_unpacked_and_damage_is_seen() {
        let mut frame =
            encode(&json!({"type": "Register"}), &[("needs", Array::integers(&[3, -1, 9]))]);
        assert_eq!(frame.len() % 8, 0);
        let (_, arrays) = decode(&frame).unwrap();
        let Elements::Integers(needs) = &arrays["needs"].elements else { panic!() };
        assert_eq!(needs, &[3, -1, 9]);
        let last = frame.len() - 1;
        frame[last] ^= 1;
        assert!(decode(&frame).is_err());
    }
}
