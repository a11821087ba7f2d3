//! origami
