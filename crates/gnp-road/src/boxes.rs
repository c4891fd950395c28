//! A tree of boxes over the pieces of a curve, for the piece that is nearest to a position.

use crate::piece::Piece;
use crate::plane::Vector;

/// Boxes by node: node 1 holds all pieces, nodes 2n and 2n + 1 the halves of what node n holds.
#[derive(Clone, Debug)]
pub(crate) struct Boxes {
    nodes: Vec<[Vector; 2]>,
    pieces: usize,
}

const NOWHERE: [Vector; 2] = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];

fn union(a: [Vector; 2], b: [Vector; 2]) -> [Vector; 2] {
    let [low, high] = [[0, 1].map(|i| a[0][i].min(b[0][i])), [0, 1].map(|i| a[1][i].max(b[1][i]))];
    [low, high]
}

impl Boxes {
    pub(crate) fn new(pieces: &[Piece]) -> Self {
        let leaves = pieces.len().next_power_of_two();
        let mut nodes = vec![NOWHERE; 2 * leaves];
        for (leaf, piece) in nodes[leaves..].iter_mut().zip(pieces) {
            *leaf = piece.corners();
        }
        for node in (1..leaves).rev() {
            nodes[node] = union(nodes[2 * node], nodes[2 * node + 1]);
        }
        Self { nodes, pieces: pieces.len() }
    }

    /// Squared distance of a position from the box of a node.
    fn distance2(&self, node: usize, position: Vector) -> f64 {
        let [low, high] = self.nodes[node];
        let outside = |i: usize| (low[i] - position[i]).max(position[i] - high[i]).max(0.);
        outside(0).powi(2) + outside(1).powi(2)
    }

    /// Asks `squared_distance` for the pieces that may be nearer than `within` (squared), likely ones first; it gives
    /// the squared distance of a piece. Returns the nearest piece and that distance.
    pub(crate) fn nearest(
        &self,
        position: Vector,
        within: f64,
        mut squared_distance: impl FnMut(usize) -> f64,
    ) -> Option<(usize, f64)> {
        let leaves = self.nodes.len() / 2;
        let (mut best, mut found) = (within, None);
        // As deep as the tree at most: of two halves one waits here.
        let mut waiting = [(0, 0.); usize::BITS as usize];
        let mut count = 1;
        waiting[0] = (1, self.distance2(1, position));
        while count > 0 {
            count -= 1;
            let (mut node, mut distance) = waiting[count];
            while distance < best {
                if node >= leaves {
                    let piece = node - leaves;
                    let exact = if piece < self.pieces { squared_distance(piece) } else { f64::INFINITY };
                    if exact < best {
                        (best, found) = (exact, Some(piece));
                    }
                    break;
                }
                let [a, b] = [2 * node, 2 * node + 1].map(|half| (half, self.distance2(half, position)));
                let (near, far) = if b.1 < a.1 { (b, a) } else { (a, b) };
                waiting[count] = far;
                count += 1;
                (node, distance) = near;
            }
        }
        found.map(|piece| (piece, best))
    }
}
