//! A drag on the live page: which values are evaluated next, and when an evaluation of older ones is given up. Logic alone, without a
//! clock.
//!
//! While values keep coming each evaluation under way may come to its end, so that a steady hand sees results throughout. When the
//! hand rests on another value than the one under way, that one is of no use any more.

use std::time::{Duration, Instant};

/// Parameters or fields, and RON.
pub(super) type Values = Vec<(String, String)>;

/// A hand that gives no newer value for so long rests. A steady one gives one every 8 to 30 ms; who waits longer waits for the result.
const REST: Duration = Duration::from_millis(120);

/// A drag, if there is one.
#[derive(Debug, Default)]
pub(super) struct Drag {
    hand: Option<Hand>,
    /// The page whose drag was ended by something else: what it says until it lets go is of that drag.
    ended: Option<u64>,
}

#[derive(Debug)]
struct Hand {
    page: u64,
    /// The newest values.
    values: Values,
    /// When they came.
    moved: Instant,
    /// Whether they have to be evaluated.
    due: bool,
    /// Whether it was told that such values are refused.
    refused: bool,
    /// The text of the graph's file in which the last values were tried.
    text: Option<String>,
}

impl Drag {
    /// A page moves its hand to these values.
    pub(super) fn moved(&mut self, page: u64, values: Values, now: Instant) {
        if self.ended == Some(page) {
            return;
        }
        let before = self.hand.take().filter(|hand| hand.page == page);
        let (refused, text) = before.map_or((false, None), |hand| (hand.refused, hand.text));
        self.hand = Some(Hand { page, values, moved: now, due: true, refused, text });
    }

    pub(super) fn is_on(&self) -> bool {
        self.hand.is_some()
    }

    /// The values to be evaluated now that nothing else is; they need not be again.
    pub(super) fn take(&mut self) -> Option<Values> {
        let hand = self.hand.as_mut().filter(|hand| hand.due)?;
        hand.due = false;
        Some(hand.values.clone())
    }

    /// The newest values have to be evaluated again.
    pub(super) fn again(&mut self) {
        if let Some(hand) = &mut self.hand {
            hand.due = true;
        }
    }

    /// When an evaluation under way is given up for newer values, if there are such and no newer ones come.
    pub(super) fn gives_up(&self) -> Option<Instant> {
        self.hand.as_ref().filter(|hand| hand.due).map(|hand| hand.moved + REST)
    }

    /// The last values that were taken fit into this text of the graph's file.
    pub(super) fn fits(&mut self, text: String) {
        if let Some(hand) = &mut self.hand {
            (hand.refused, hand.text) = (false, Some(text));
        }
    }

    /// The last values that were taken do not do; whether that is news.
    pub(super) fn refused(&mut self) -> bool {
        let hand = self.hand.as_mut();
        hand.is_some_and(|hand| !std::mem::replace(&mut hand.refused, true))
    }

    /// A page lets go; whether it was the one that dragged.
    pub(super) fn let_go(&mut self, page: u64) -> bool {
        self.ended = self.ended.filter(|ended| *ended != page);
        self.hand.take_if(|hand| hand.page == page).is_some()
    }

    /// The graph's file has this text now; whether that ends a drag that began with another one. The page's hand is ignored until it
    /// lets go.
    pub(super) fn ends_by(&mut self, text: &str) -> bool {
        let ended = self
            .hand
            .take_if(|hand: &mut Hand| hand.text.as_ref().is_some_and(|known| known != text));
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

    /// What a page says on the way, by milliseconds; each evaluation takes this long, or as long as it takes until it is given up.
    /// Gives the values that were evaluated, each with the time of its end, and a `!` if it was given up.
    fn check(takes: u64, moves: &[(u64, u32)], expected: &[(u64, &str)]) {
        let start = Instant::now();
        fn at(now: u64, start: &Instant) -> Instant {
            *start + Duration::from_millis(now)
        }
        let (mut drag, mut running, mut ends) = (Drag::default(), None, Vec::new());
        let mut moves = moves.iter().peekable();
        for now in 0..3000 {
            while let Some((_, value)) = moves.next_if(|(when, _)| *when == now) {
                drag.moved(0, growth(*value), at(now, &start));
            }
            let given_up = drag.gives_up().is_some_and(|due| due <= at(now, &start));
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
    fn a_quick_graph_follows_the_hand() {
        check(5, &[(0, 1), (16, 2), (32, 3)], &[(5, "1.0"), (21, "2.0"), (37, "3.0")]);
    }

    #[test]
    fn the_latest_value_wins_and_the_last_one_always_arrives() {
        let moves = [(0, 1), (16, 2), (32, 3), (48, 4)];
        check(40, &moves, &[(40, "1.0"), (80, "3.0"), (120, "4.0")]);
    }

    #[test]
    fn a_steady_hand_sees_results_of_a_slow_graph_throughout() {
        let moves: Vec<_> = (0..100).map(|k| (u64::from(k) * 16, k)).collect();
        let seen = [(500, "0.0"), (1000, "31.0"), (1500, "62.0")];
        // When it rests, what is under way is given up for the last value.
        check(500, &moves, &[&seen[..], &[(1704, "93.0!"), (2204, "99.0")]].concat());
    }

    #[test]
    fn a_hand_that_rests_gives_up_the_older_value() {
        check(1000, &[(0, 1), (50, 2)], &[(170, "1.0!"), (1170, "2.0")]);
        // Not if it rests on the value that is under way.
        check(1000, &[(0, 1)], &[(1000, "1.0")]);
    }

    #[test]
    fn who_lets_go_drags_no_more_and_nobody_else_lets_go_for_them() {
        let (mut drag, now) = (Drag::default(), Instant::now());
        drag.moved(3, growth(1), now);
        assert!(!drag.let_go(4) && drag.is_on());
        assert!(drag.let_go(3) && !drag.is_on());
        assert_eq!((drag.take(), drag.gives_up()), (None, None));
        drag.moved(3, growth(2), now);
        assert_eq!(drag.take(), Some(growth(2)));
        // Another hand takes over.
        drag.moved(4, growth(5), now);
        assert!(!drag.let_go(3));
        assert_eq!(drag.take(), Some(growth(5)));
        assert_eq!(drag.take(), None);
        drag.again();
        assert_eq!(drag.take(), Some(growth(5)));
    }

    #[test]
    fn the_file_wins_until_the_hand_lets_go() {
        let (mut drag, now) = (Drag::default(), Instant::now());
        drag.moved(0, growth(1), now);
        // What was there before the first value was tried is what it is tried in.
        assert!(!drag.ends_by("a"));
        drag.fits("a".into());
        assert!(!drag.ends_by("a") && drag.is_on());
        assert!(drag.ends_by("b") && !drag.is_on());
        assert!(!drag.ends_by("c"));
        drag.moved(0, growth(2), now);
        assert!(!drag.is_on());
        drag.moved(1, growth(3), now);
        assert!(drag.is_on());
        drag.let_go(0);
        drag.moved(0, growth(2), now);
        assert_eq!(drag.take(), Some(growth(2)));
    }

    #[test]
    fn one_refusal_is_told_until_a_value_does() {
        let (mut drag, now) = (Drag::default(), Instant::now());
        let mut told = [true, true, false, true].map(|is_wrong| {
            drag.moved(0, growth(1), now);
            if !is_wrong {
                drag.fits("a".into());
            }
            is_wrong && drag.refused()
        });
        assert_eq!(told, [true, false, false, true]);
        drag.let_go(0);
        drag.moved(0, growth(1), now);
        told[0] = drag.refused();
        assert!(told[0]);
    }
}
