//! What a build without Rerun says.

use gnp_replay::{CAN_ENCODE, ReplayError, encode};

use crate::clip::clip;

#[test]
fn a_build_without_rerun_says_so() {
    const { assert!(!CAN_ENCODE) };
    let error = encode(&clip(), None).unwrap_err();
    assert!(matches!(error, ReplayError::WithoutRerun) && error.to_string().contains("feature `rerun`"), "{error}");
}
