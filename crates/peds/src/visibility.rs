//! Who sees whom: the paper contradicts itself on which crowds react to the robot, so it is a matrix in the config.

use serde::{Deserialize, Serialize};

use crate::CrowdKind;

/// What the pedestrians of one crowd see.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Visibility {
    /// Each other.
    pub pedestrians: bool,
    /// The robot.
    pub robot: bool,
}

impl Visibility {
    /// Pedestrians and robot.
    pub const ALL: Self = Self { pedestrians: true, robot: true };
    /// Pedestrians alone.
    pub const PEDESTRIANS: Self = Self { pedestrians: true, robot: false };
}

/// One row per crowd. By default pedestrians see each other, and NH and SO see the robot, too.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "UPPERCASE")]
pub struct VisibilityMatrix {
    /// Row of NH.
    pub nh: Visibility,
    /// Row of IN.
    pub r#in: Visibility,
    /// Row of VA.
    pub va: Visibility,
    /// Row of SO.
    pub so: Visibility,
    /// Row of VO.
    pub vo: Visibility,
    /// Row of SF.
    pub sf: Visibility,
}

impl Default for VisibilityMatrix {
    fn default() -> Self {
        Self {
            nh: Visibility::ALL,
            r#in: Visibility::PEDESTRIANS,
            va: Visibility::PEDESTRIANS,
            so: Visibility::ALL,
            vo: Visibility::PEDESTRIANS,
            sf: Visibility::PEDESTRIANS,
        }
    }
}

impl VisibilityMatrix {
    /// The row of a crowd.
    pub fn of(&self, kind: CrowdKind) -> Visibility {
        match kind {
            CrowdKind::Nh => self.nh,
            CrowdKind::In => self.r#in,
            CrowdKind::Va => self.va,
            CrowdKind::So => self.so,
            CrowdKind::Vo => self.vo,
            CrowdKind::Sf => self.sf,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_nh_and_so_see_the_robot_by_default() {
        let matrix = VisibilityMatrix::default();
        for kind in CrowdKind::ALL {
            let expected = matches!(kind, CrowdKind::Nh | CrowdKind::So);
            assert_eq!(matrix.of(kind), Visibility { pedestrians: true, robot: expected });
        }
    }

    #[test]
    fn a_row_can_be_changed_by_name() {
        let text = r#"{"VO":{"pedestrians":false,"robot":true}}"#;
        let matrix: VisibilityMatrix = serde_json::from_str(text).unwrap();
        assert_eq!(matrix.of(CrowdKind::Vo), Visibility { pedestrians: false, robot: true });
        assert_eq!(matrix.of(CrowdKind::Nh), Visibility::ALL);
        assert!(serde_json::from_str::<VisibilityMatrix>(r#"{"XX":{}}"#).is_err());
    }
}
