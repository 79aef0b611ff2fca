//! The matrix of who sees whom: the paper contradicts itself on which crowds react to the robot, so
//! the configuration says it.

use serde::{Deserialize, Serialize};

use crate::CrowdKind;

/// The bodies that the pedestrians of one crowd see.
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
    /// Pedestrians only.
    pub const PEDESTRIANS: Self = Self { pedestrians: true, robot: false };
    /// Nobody.
    pub const NONE: Self = Self { pedestrians: false, robot: false };
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
    /// The row of a crowd: cross-play has that of NH, the straight and the stop-and-go walkers and
    /// recorded people see nobody whatever the matrix says. A crowd of one's own says for itself
    /// what it sees ([`crate::Crowd::visibility`]).
    pub fn row(&self, kind: CrowdKind) -> Visibility {
        match kind {
            CrowdKind::Straight | CrowdKind::StopAndGo | CrowdKind::Recorded => Visibility::NONE,
            CrowdKind::Nh | CrowdKind::CrossPlay => self.nh,
            CrowdKind::In => self.r#in,
            CrowdKind::Va => self.va,
            CrowdKind::So => self.so,
            CrowdKind::Vo => self.vo,
            CrowdKind::Sf => self.sf,
        }
    }

    /// The row of a crowd, to be changed; `None` for those whose visibility the matrix does not
    /// say.
    pub fn row_mut(&mut self, kind: CrowdKind) -> Option<&mut Visibility> {
        match kind {
            CrowdKind::Nh | CrowdKind::CrossPlay => Some(&mut self.nh),
            CrowdKind::In => Some(&mut self.r#in),
            CrowdKind::Va => Some(&mut self.va),
            CrowdKind::So => Some(&mut self.so),
            CrowdKind::Vo => Some(&mut self.vo),
            CrowdKind::Sf => Some(&mut self.sf),
            CrowdKind::Straight | CrowdKind::StopAndGo | CrowdKind::Recorded => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_nh_and_so_see_the_robot_by_default() {
        let matrix = VisibilityMatrix::default();
        for kind in CrowdKind::PAPER {
            let expected = matches!(kind, CrowdKind::Nh | CrowdKind::So);
            assert_eq!(matrix.row(kind), Visibility { pedestrians: true, robot: expected });
        }
        let validation = CrowdKind::VALIDATION.map(|kind| matrix.row(kind));
        assert_eq!(validation, [Visibility::NONE, Visibility::NONE, Visibility::ALL]);
    }

    #[test]
    fn rows_are_changed_where_there_are_rows() {
        for kind in CrowdKind::built_in() {
            let mut matrix = VisibilityMatrix::default();
            let row = Visibility { pedestrians: false, robot: true };
            if let Some(found) = matrix.row_mut(kind) {
                *found = row;
                assert_eq!(matrix.row(kind), row);
            } else {
                let blind = [CrowdKind::Straight, CrowdKind::StopAndGo, CrowdKind::Recorded];
                assert!(blind.contains(&kind), "{kind}");
            }
        }
    }

    #[test]
    fn a_row_can_be_changed_by_name() {
        let text = r#"{"VO":{"pedestrians":false,"robot":true}}"#;
        let matrix: VisibilityMatrix = serde_json::from_str(text).unwrap();
        assert_eq!(matrix.row(CrowdKind::Vo), Visibility { pedestrians: false, robot: true });
        assert_eq!(matrix.row(CrowdKind::Nh), Visibility::ALL);
        assert!(serde_json::from_str::<VisibilityMatrix>(r#"{"XX":{}}"#).is_err());
    }
}
