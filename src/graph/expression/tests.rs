//! Tests of the results and error messages of expressions.

use super::*;

fn value(text: &str) -> Result<Outcome, String> {
    fn number(value: f64, unit: &str) -> Outcome {
        let unit = Unit::read(unit).unwrap_or_default();
        Outcome::Number(Quantity { value, unit })
    }
    let parameters = BTreeMap::from([
        ("growth".to_owned(), number(12.0, "")),
        ("eye-step".to_owned(), number(3.0, "")),
        ("eye".to_owned(), number(5.0, "")),
        ("zero".to_owned(), number(0.0, "")),
        ("depth".to_owned(), number(12.0, "mm")),
        ("width".to_owned(), number(2.5, "cm")),
        ("turn".to_owned(), number(30.0, "deg")),
        ("band".to_owned(), number(4.0, "px")),
        ("flat".to_owned(), Outcome::Truth(true)),
        ("shift.x".to_owned(), number(2.0, "mm")),
        ("shift.y".to_owned(), number(0.5, "mm")),
    ]);
    evaluate(text, &parameters).map_err(|error| {
        fn place(at: &Range<usize>, text: &str) -> String {
            text[at.clone()].to_owned()
        }
        let at =
            error.at.as_ref().map_or_else(String::new, |at| format!(" at {}", place(at, text)));
        let note = error.note.as_ref();
        let note = note.map_or_else(String::new, |note| {
            let (at, words) = &**note;
            format!(" ({}: {words})", place(at, text))
        });
        format!("{error}; {}{at}{note}", error.help(&parameters))
    })
}

fn check(text: &str, expected: f64) {
    assert_eq!(value(text), Ok(Outcome::Number(Quantity::pure(expected))), "{text}");
}

fn check_unit(text: &str, expected: f64, unit: &str) {
    let unit = Unit::read(unit).unwrap_or_else(|| panic!("{unit}"));
    let expected = Outcome::Number(Quantity { value: expected, unit });
    assert_eq!(value(text), Ok(expected), "{text}");
}

#[test]
fn arithmetic_binds_as_usual() {
    check("growth / 2 + 1", 7.0);
    check("2 + 3 * -4", -10.0);
    check("(2 + 3) * 4 % 6", 2.0);
    check("10 - 2 - 3", 5.0);
    check("1e-3 * 1000", 1.0);
    check("clamp(growth, 0, 10) + max(1, 2, 3) + sqrt(4) + round(0.6)", 16.0);
    check("if(growth > 10 and not flat or false, 1, 2)", 2.0);
}

#[test]
fn a_hyphen_belongs_to_a_known_name_and_subtracts_otherwise() {
    check("eye-step", 3.0);
    check("eye-1", 4.0);
    check("growth-eye-step", 9.0);
    check("eye -step-1".trim_end_matches("-step-1"), 5.0);
}

#[test]
fn a_vector_is_taken_apart_into_its_numbers() {
    check_unit("shift.x - shift.y * 2", 1.0, "mm");
    check_unit("max(shift.x,.5)", 2.0, "mm");
    check("growth *.5", 6.0);
    fn wrong(text: &str) -> String {
        value(text).expect_err(text)
    }
    assert_eq!(wrong("shift.z"), "`shift` has no `.z`: its last number is `shift.y`; ");
    assert_eq!(wrong("growth.x"), "`growth.x`: `growth` is not a vector; write `growth`");
    assert!(wrong("shape.x").starts_with("the graph has no parameter `shape`"));
    assert!(wrong("shift.xy").starts_with("`.xy` is not a number"));
    let names = named_parameters("shift.x and a.y - shift.y", &|_| true);
    assert_eq!(names, Some(vec![0..5, 12..13, 18..23]));
}

#[test]
fn the_parameters_in_an_expression_are_those_that_it_is_computed_from() {
    fn parameters_in(text: &str) -> Option<String> {
        let is_known = |name: &str| matches!(name, "a" | "a-b" | "min" | "and");
        let names = named_parameters(text, &is_known)?;
        Some(names.into_iter().map(|at| text[at].to_owned()).collect::<Vec<_>>().join(" "))
    }
    assert_eq!(parameters_in("a - b-1").as_deref(), Some("a b"));
    assert_eq!(parameters_in(" a-b*min(min, 2)-a").as_deref(), Some("a-b min a"));
    assert_eq!(parameters_in("if(not a and and, (a) and 1e3, 2)").as_deref(), Some("a and a"));
    assert_eq!(parameters_in("a $"), None);
}

#[test]
fn what_measures_the_same_is_added_in_the_unit_of_the_first() {
    check_unit("depth + cm(1)", 22.0, "mm");
    check_unit("cm(1) + depth", 2.2, "cm");
    check_unit("depth - width", -13.0, "mm");
    check_unit("width % mm(10)", 0.5, "cm");
    check_unit("min(depth, width, 3)", 3.0, "mm");
    check_unit("clamp(width, mm(5), inch(0.5))", 1.27, "cm");
    check_unit("if(depth < width, turn, rad(0))", 30.0, "deg");
    assert_eq!(value("depth == mm(12) and depth < width"), Ok(Outcome::Truth(true)));
}

#[test]
fn a_pure_number_takes_on_the_unit_of_what_it_meets() {
    check_unit("depth + 2", 14.0, "mm");
    check_unit("2 * 4 + depth", 20.0, "mm");
    check_unit("max(1, width)", 2.5, "cm");
    check_unit("-depth / 2", -6.0, "mm");
    check_unit("floor(width)", 2.0, "cm");
    check_unit("mm(2 * growth)", 24.0, "mm");
}

#[test]
fn products_and_quotients_combine_units_or_cancel_them() {
    check("depth / mm(2)", 6.0);
    check("width / mm(5)", 5.0);
    check_unit("depth * width", 300.0, "mm^2");
    check_unit("sqrt(depth * mm(3))", 6.0, "mm");
    check_unit("1 / width", 0.4, "1/cm");
    check_unit("depth * (band / mm(3))", 16.0, "px");
}

#[test]
fn units_that_do_not_go_together_are_named_with_both_places() {
    fn error_of(text: &str) -> String {
        value(text).unwrap_err()
    }
    let help = "use values of the same kind";
    assert_eq!(
        error_of("2 * depth + turn"),
        format!(
            "`+` wants one unit, but `2 * depth` is in mm and `turn` in deg; {help} at turn (2 * depth: this is in mm)"
        )
    );
    assert_eq!(
        error_of("min(1, px(2), depth)"),
        format!(
            "`min` wants one unit, but `px(2)` is in px and `depth` in mm; {help} at depth (px(2): this is in px)"
        )
    );
    assert_eq!(
        error_of("if(flat, band, turn)"),
        format!(
            "`if` wants one unit, but `band` is in px and `turn` in deg; {help} at turn (band: this is in px)"
        )
    );
    assert!(error_of("depth < band").starts_with("`<` wants one unit, but `depth` is in mm"));
    assert!(
        error_of("depth * width - depth").contains("`depth * width` is in mm^2 and `depth` in mm")
    );
    assert_eq!(
        error_of("sqrt(depth)"),
        "`sqrt` wants a square, as mm^2 is, but `depth` is in mm;  at depth"
    );
    assert_eq!(error_of("cm(depth)"), "`cm` wants a pure number, but `depth` is in mm;  at depth");
    assert_eq!(error_of("inhc(2)"), "there is no function `inhc`; did you mean `inch`?");
}

#[test]
fn what_is_not_finite_is_an_error_wherever_it_arises() {
    fn error_of(text: &str) -> String {
        value(text).unwrap_err()
    }
    for (text, message) in [
        ("max(zero / zero, 3)", "`zero / zero` gives NaN, from 0 and 0"),
        ("min(growth % zero, 3)", "`growth % zero` gives NaN, from 12 and 0"),
        ("clamp(depth / zero, 0, 5)", "`depth / zero` gives inf, from 12 and 0"),
        ("max(sqrt(-growth), 1)", "`sqrt(-growth)` gives NaN, from -12"),
        ("1 / (1 / zero)", "`1 / zero` gives inf, from 1 and 0"),
        ("pow(growth, 999) > 1", "`pow(growth, 999)` gives inf, from 12 and 999"),
        ("min(asin(growth), 1)", "`asin(growth)` gives NaN, from 12"),
        ("tan(deg(90)) - 1", "`tan(deg(90))` gives inf, from 90"),
        ("1e308 * 10 > 0", "`1e308 * 10` gives inf, from 1e308 and 10"),
        ("if(zero / zero > 1, 1, 2)", "`zero / zero` gives NaN, from 0 and 0"),
        ("min(1, 1e999)", "`1e999` is too large for a number"),
    ] {
        assert!(error_of(text).starts_with(message), "{text}: {}", error_of(text));
    }
}

#[test]
fn what_does_not_count_need_not_be_finite() {
    check("if(zero > 0, growth / zero, 7)", 7.0);
    check("if(zero == 0, 7, if(flat, growth % zero, sqrt(-1)))", 7.0);
    assert_eq!(value("zero > 0 and growth / zero > 1"), Ok(Outcome::Truth(false)));
    assert_eq!(value("zero == 0 or growth / zero > 1"), Ok(Outcome::Truth(true)));
    let parameters = BTreeMap::from([("a".to_owned(), Outcome::Number(Quantity::pure(f64::NAN)))]);
    assert_eq!(evaluate_any("a * 2 > 1", &parameters), Ok(Outcome::Truth(false)));
}

#[test]
fn what_is_computed_from_nan_is_nan_and_compares_with_nothing() {
    let parameters = BTreeMap::from([("a".to_owned(), Outcome::Number(Quantity::pure(f64::NAN)))]);
    for name in function_names().filter(|name| *name != "if") {
        let function = Function::find(name).unwrap();
        for (place, count) in (function.min_arguments..=function.max_arguments.min(3))
            .flat_map(|n| (0..n).map(move |k| (k, n)))
        {
            let argument = |k: usize| if k == place { "a" } else { ["0", "1", "2"][k] };
            let call =
                format!("{name}({})", (0..count).map(argument).collect::<Vec<_>>().join(", "));
            let Ok(Outcome::Number(found)) = evaluate_any(&call, &parameters) else {
                panic!("{call}")
            };
            assert!(found.value.is_nan(), "{call} is {}", found.value);
        }
    }
    for operator in ["<", "<=", ">", ">=", "==", "!="] {
        for text in [format!("a {operator} 1"), format!("1 {operator} min(a, 1)")] {
            assert_eq!(evaluate_any(&text, &parameters), Ok(Outcome::Truth(false)), "{text}");
        }
    }
    assert_eq!(value("1 != 2 and not (1 != 1)"), Ok(Outcome::Truth(true)));
}

#[test]
fn angles_are_computed_in_their_units() {
    fn check_near(text: &str, expected: f64, unit: &str) {
        let Ok(Outcome::Number(found)) = value(text) else { panic!("{text}: {:?}", value(text)) };
        assert!((found.value - expected).abs() < 1e-14, "{text}: {}", found.value);
        assert_eq!(found.unit, Unit::read(unit).unwrap_or_default(), "{text}");
    }
    check_near("sin(turn)", 0.5, "");
    check_near("sin(pi / 6)", 0.5, "");
    check_near("depth * cos(deg(60))", 6.0, "mm");
    check_near("tan(rad(pi / 4))", 1.0, "");
    check_near("asin(1) / deg(1)", 90.0, "");
    check_near("acos(0)", std::f64::consts::FRAC_PI_2, "rad");
    check_near("atan(1)", std::f64::consts::FRAC_PI_4, "rad");
    check_near("atan2(depth, cm(1.2))", std::f64::consts::FRAC_PI_4, "rad");
    check("cos(deg(90)) + sin(deg(-180)) + sin(deg(720))", 0.0);
    check("sin(deg(450)) - cos(deg(-180))", 2.0);
    fn error_of(text: &str) -> String {
        value(text).unwrap_err()
    }
    assert_eq!(error_of("sin(depth)"), "`sin` wants an angle, but `depth` is in mm;  at depth");
    assert!(error_of("atan2(depth, turn)").starts_with("`atan2` wants one unit"));
    assert_eq!(
        error_of("acos(turn)"),
        "`acos` wants a pure number, but `turn` is in deg;  at turn"
    );
}

#[test]
fn powers_have_powers_of_units() {
    check("pow(2, 10) + pow(4, 0.5)", 1026.0);
    check_unit("pow(depth, 2)", 144.0, "mm^2");
    check_unit("pow(width, -1)", 0.4, "1/cm");
    check("pow(depth, 0)", 1.0);
    fn error_of(text: &str) -> String {
        value(text).unwrap_err()
    }
    assert_eq!(
        error_of("pow(depth, 0.5)"),
        "`pow` wants a pure number or a whole exponent, but `depth` is in mm;  at depth"
    );
    assert!(error_of("pow(2, depth)").contains("but `depth` is in mm"));
}

#[test]
fn a_parameter_may_have_the_name_of_a_constant() {
    let parameters = BTreeMap::from([("pi".to_owned(), Outcome::Number(Quantity::pure(3.0)))]);
    assert_eq!(evaluate("pi", &parameters), Ok(Outcome::Number(Quantity::pure(3.0))));
    fn names_beside(text: &str, parameter: &str) -> Vec<String> {
        let spans = named_parameters(text, &|name| name == parameter).unwrap();
        spans.into_iter().map(|span| text[span].to_owned()).collect::<Vec<_>>()
    }
    assert_eq!(names_beside("pi + true", "pi"), ["pi"]);
    assert_eq!(names_beside("pi + a", ""), ["a"]);
}

#[test]
fn a_long_expression_is_read_in_time() {
    let start = std::time::Instant::now();
    let parameters: BTreeMap<_, _> =
        (0..20_000).map(|k| (format!("a-{k}"), Outcome::Number(Quantity::pure(1.0)))).collect();
    let names = "a-".repeat(50_000) + "a-1";
    assert!(evaluate(&names, &parameters).is_err());
    let sum = (0..20_000).map(|k| format!("a-{k}")).collect::<Vec<_>>().join(" + ");
    assert_eq!(evaluate(&sum, &parameters), Ok(Outcome::Number(Quantity::pure(20_000.0))));
    assert!(start.elapsed().as_secs() < 60, "{:?}", start.elapsed());
}

#[test]
fn errors_are_explained() {
    fn error_of(text: &str) -> String {
        value(text).unwrap_err()
    }
    assert_eq!(error_of("growth * "), "the expression ends where a number or a name should be; ");
    assert_eq!(error_of("grwth"), "the graph has no parameter `grwth`; did you mean `growth`?");
    assert_eq!(error_of("flor(1)"), "there is no function `flor`; did you mean `floor`?");
    assert_eq!(
        error_of("1 + 1 / 0"),
        "`1 / 0` gives inf, from 1 and 0; give another value where it is 0: if(b == 0, 0, a / b) at 1 / 0"
    );
    assert_eq!(error_of("1 + flat"), "`+`: expected a number, found a condition; ");
    assert_eq!(error_of("(1"), "the expression ends where `)` should be; ");
    assert_eq!(error_of("1 2"), "expected the end of the expression, found `2`; ");
    assert_eq!(error_of("1 $ 2"), "`$` has no meaning in an expression; ");
    assert!(error_of(&"(".repeat(9999)).contains("nested too deeply"));
}
