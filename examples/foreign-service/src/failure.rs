//! Why the service ends before the coupler has told it to stop.

use std::fmt;

#[derive(Debug)]
pub enum Failure {
    /// The case asks for something that this service cannot do.
    Input(String),
    /// This rank failed, or another one (`culprit`, such as `md/0`) sent what cannot be used.
    Failed { reason: String, culprit: String },
    /// The coupler ended the run or is gone: it need not be told.
    Lost(String),
}

impl Failure {
    pub fn own(reason: impl fmt::Display) -> Failure {
        Failure::Failed { reason: reason.to_string(), culprit: String::new() }
    }

    pub fn exit_code(&self) -> u8 {
        if matches!(self, Failure::Input(_)) {
            2
        } else {
            3
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Failure::Input(reason) | Failure::Failed { reason, .. } | Failure::Lost(reason) => {
                f.write_str(reason)
            }
        }
    }
}
