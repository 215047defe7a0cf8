//! Handles drags of parameters on live pages. Decides which values are evaluated next, and when a running evaluation of older values is
//! cancelled. This module uses no clock.
//!
//! While new values arrive, each evaluation is completed, so that the user sees results during the drag. When the pointer rests, an
//! evaluation of older values is cancelled in favor of the newest ones.

use std::time::{Duration, Instant};

/// Values of parameters or fields: pairs of a name and the value as RON.
pub(super) type Values = Vec<(String, String)>;

/// The time without new values after which the pointer is considered to rest. While the pointer moves, the page sends a value every 8 to 30
/// ms.
const REST_TIME: Duration = Duration::from_millis(120);

/// The drags on live pages. At most one drag is active at a time.
#[derive(Debug, Default)]
pub(super) struct Drag {
    state: Option<DragState>,
    /// The page whose drag was ended because the graph file changed. Values from that page are ignored until the user releases the pointer.
    ended: Option<u64>,
}

#[derive(Debug)]
struct DragState {
    page: u64,
    /// The newest values of the drag.
    values: Values,
    /// The time at which the newest values arrived.
    moved: Instant,
    /// True if the newest values have not been evaluated yet.
    is_due: bool,
    /// True if the user has been told that the values are invalid.
    refused: bool,
    /// The text of the graph file with which the last values were found to be valid.
    text: Option<String>,
}

impl Drag {
    /// Records new values that a page has sent.
    pub(super) fn move_to(&mut self, page: u64, values: Values, now: Instant) {
        if self.ended == Some(page) {
            return;
        }
        let before = self.state.take().filter(|hand| hand.page == page);
        let (refused, text) = before.map_or((false, None), |hand| (hand.refused, hand.text));
        self.state = Some(DragState { page, values, moved: now, is_due: true, refused, text });
    }

    pub(super) fn is_active(&self) -> bool {
        self.state.is_some()
    }

    /// Returns the newest values if they have not been evaluated, and marks them as evaluated.
    pub(super) fn take(&mut self) -> Option<Values> {
        let hand = self.state.as_mut().filter(|hand| hand.is_due)?;
        hand.is_due = false;
        Some(hand.values.clone())
    }

    /// Marks the newest values as not evaluated, so that they are evaluated once more.
    pub(super) fn mark_due(&mut self) {
        if let Some(hand) = &mut self.state {
            hand.is_due = true;
        }
    }

    /// Returns the time at which the running evaluation is to be cancelled, unless more values arrive before. Returns `None` if the newest
    /// values are being evaluated.
    pub(super) fn abandon_at(&self) -> Option<Instant> {
        self.state.as_ref().filter(|hand| hand.is_due).map(|hand| hand.moved + REST_TIME)
    }

    /// Records that the last values are valid for a graph file with this text.
    pub(super) fn accept_text(&mut self, text: String) {
        if let Some(hand) = &mut self.state {
            (hand.refused, hand.text) = (false, Some(text));
        }
    }

    /// Records that the last values are invalid. Returns true if the user has not been told yet.
    pub(super) fn note_refusal(&mut self) -> bool {
        let hand = self.state.as_mut();
        hand.is_some_and(|hand| !std::mem::replace(&mut hand.refused, true))
    }

    /// Ends the drag if it is a drag on this page. Returns true if it was.
    pub(super) fn release(&mut self, page: u64) -> bool {
        self.ended = self.ended.filter(|ended| *ended != page);
        self.state.take_if(|hand| hand.page == page).is_some()
    }

    /// Ends the drag if the text of the graph file has changed, and returns true if it has. Values from the page are then ignored until the
    /// user releases the pointer.
    pub(super) fn end_on_change(&mut self, text: &str) -> bool {
        let ended = self
            .state
            .take_if(|hand: &mut DragState| hand.text.as_ref().is_some_and(|known| known != text));
        self.ended = ended.as_ref().map(|hand| hand.page).or(self.ended);
        ended.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn growth(value: u32) -> Values {
        vec![("growth".into(), format!("{value}.0"))]
    }

    /// Simulates a drag. Times are in milliseconds. `takes` is the duration of an evaluation, and `moves` are the values with their times.
    /// `expected` are the evaluated values with the end times of their evaluations; `!` marks a cancelled evaluation.
    fn check(takes: u64, moves: &[(u64, u32)], expected: &[(u64, &str)]) {
        let start = Instant::now();
        fn instant_at(now: u64, start: &Instant) -> Instant {
            *start + Duration::from_millis(now)
        }
        let (mut drag, mut running, mut ends) = (Drag::default(), None, Vec::new());
        let mut moves = moves.iter().peekable();
        for now in 0..3000 {
            while let Some((_, value)) = moves.next_if(|(when, _)| *when == now) {
                drag.move_to(0, growth(*value), instant_at(now, &start));
            }
            let given_up = drag.abandon_at().is_some_and(|due| due <= instant_at(now, &start));
            if let Some((_, value)) =
                running.take_if(|(since, _): &mut (u64, String)| given_up || *since + takes == now)
            {
                ends.push((now, if given_up { format!("{value}!") } else { value }));
            }
            if running.is_none() {
                running = drag.take().map(|values| (now, values[0].1.clone()));
            }
        }
        let ends: Vec<_> = ends.iter().map(|(now, value)| (*now, &value[..])).collect();
        assert_eq!(ends, expected);
    }

    #[test]
    fn a_fast_graph_evaluates_every_value() {
        check(5, &[(0, 1), (16, 2), (32, 3)], &[(5, "1.0"), (21, "2.0"), (37, "3.0")]);
    }

    #[test]
    fn older_values_are_skipped_and_the_last_one_is_evaluated() {
        let moves = [(0, 1), (16, 2), (32, 3), (48, 4)];
        check(40, &moves, &[(40, "1.0"), (80, "3.0"), (120, "4.0")]);
    }

    #[test]
    fn a_moving_pointer_gets_results_of_a_slow_graph() {
        let moves: Vec<_> = (0..100).map(|k| (u64::from(k) * 16, k)).collect();
        let seen = [(500, "0.0"), (1000, "31.0"), (1500, "62.0")];
        // When the pointer rests, the evaluation of an older value is cancelled in favor of the last value.
        check(500, &moves, &[&seen[..], &[(1704, "93.0!"), (2204, "99.0")]].concat());
    }

    #[test]
    fn a_resting_pointer_abandons_the_older_value() {
        check(1000, &[(0, 1), (50, 2)], &[(170, "1.0!"), (1170, "2.0")]);
        // An evaluation of the last value is not cancelled when the pointer rests.
        check(1000, &[(0, 1)], &[(1000, "1.0")]);
    }

    #[test]
    fn only_the_dragging_page_ends_its_drag() {
        let (mut drag, now) = (Drag::default(), Instant::now());
        drag.move_to(3, growth(1), now);
        assert!(!drag.release(4) && drag.is_active());
        assert!(drag.release(3) && !drag.is_active());
        assert_eq!((drag.take(), drag.abandon_at()), (None, None));
        drag.move_to(3, growth(2), now);
        assert_eq!(drag.take(), Some(growth(2)));
        // The user of page 4 takes over the drag from page 3.
        drag.move_to(4, growth(5), now);
        assert!(!drag.release(3));
        assert_eq!(drag.take(), Some(growth(5)));
        assert_eq!(drag.take(), None);
        drag.mark_due();
        assert_eq!(drag.take(), Some(growth(5)));
    }

    #[test]
    fn a_change_of_the_file_ends_the_drag_until_the_page_releases() {
        let (mut drag, now) = (Drag::default(), Instant::now());
        drag.move_to(0, growth(1), now);
        // Until the first values are evaluated, the text of the file is unknown, so no text can end the drag.
        assert!(!drag.end_on_change("a"));
        drag.accept_text("a".into());
        assert!(!drag.end_on_change("a") && drag.is_active());
        assert!(drag.end_on_change("b") && !drag.is_active());
        assert!(!drag.end_on_change("c"));
        drag.move_to(0, growth(2), now);
        assert!(!drag.is_active());
        drag.move_to(1, growth(3), now);
        assert!(drag.is_active());
        drag.release(0);
        drag.move_to(0, growth(2), now);
        assert_eq!(drag.take(), Some(growth(2)));
    }

    #[test]
    fn an_invalid_value_is_reported_once_until_a_valid_one() {
        let (mut drag, now) = (Drag::default(), Instant::now());
        let mut told = [true, true, false, true].map(|is_wrong| {
            drag.move_to(0, growth(1), now);
            if !is_wrong {
                drag.accept_text("a".into());
            }
            is_wrong && drag.note_refusal()
        });
        assert_eq!(told, [true, false, false, true]);
        drag.release(0);
        drag.move_to(0, growth(1), now);
        told[0] = drag.note_refusal();
        assert!(told[0]);
    }
}
