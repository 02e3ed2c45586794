use super::*;
use proptest::prelude::*;

fn form(delimiter: Delimiter, fields: usize) -> LineForm {
    LineForm { delimiter, decimal: Decimal::Point, comment: None, prefix: Vec::new(), fields }
}

fn numbers(form: &LineForm, line: &str) -> Result<Option<Vec<f64>>, Malformed> {
    let Some(fields) = form.parse(line.as_bytes())? else { return Ok(None) };
    let which: Vec<usize> = (0..form.fields).collect();
    let mut out = Vec::new();
    fields.numbers(&which, &mut out)?;
    Ok(Some(out))
}

#[test]
fn each_delimiter_takes_a_line_apart() {
    let three = |delimiter, line| numbers(&form(delimiter, 3), line).unwrap().unwrap();
    assert_eq!(three(Delimiter::Spaces, "  1.5   -2\t3e2 "), [1.5, -2.0, 300.0]);
    assert_eq!(three(Delimiter::Tab, "1.5\t -2 \t3e2"), [1.5, -2.0, 300.0]);
    assert_eq!(three(Delimiter::Comma, "1.5, -2,3e2,"), [1.5, -2.0, 300.0]);
    let comma = LineForm { decimal: Decimal::Comma, ..form(Delimiter::Semicolon, 3) };
    assert_eq!(numbers(&comma, "1,5;-2;3,0e2"), Ok(Some(vec![1.5, -2.0, 300.0])));
    assert_eq!(numbers(&comma, "1.500,0;-2;3"), Err(Malformed::Number { field: 1 }));
}

#[test]
fn what_says_nothing_is_passed_over_and_what_is_wrong_is_named() {
    let form = LineForm { comment: Some(b'#'), prefix: b"$FP,".to_vec(), ..form(Delimiter::Comma, 2) };
    for line in ["", "  ", "# a remark", " # another", "$GP,1,2"] {
        assert_eq!(numbers(&form, line), Ok(None), "{line}");
    }
    assert_eq!(numbers(&form, "$FP,1,2"), Ok(Some(vec![1.0, 2.0])));
    assert_eq!(numbers(&form, "$FP,1,2,3"), Err(Malformed::Fields { got: 3, want: 2 }));
    assert_eq!(numbers(&form, "$FP,1,two"), Err(Malformed::Number { field: 2 }));
    assert_eq!(numbers(&form, "$FP,1,"), Err(Malformed::Fields { got: 1, want: 2 }));
    assert_eq!(numbers(&form, "$FP,,1"), Err(Malformed::Number { field: 1 }));
}

#[test]
fn an_unused_field_may_hold_any_text() {
    let form = form(Delimiter::Semicolon, 3);
    let fields = form.parse(b"1;\xff\xfe;3").unwrap().unwrap();
    let mut out = Vec::new();
    fields.numbers(&[0, 2], &mut out).unwrap();
    assert_eq!(out, [1.0, 3.0]);
    assert_eq!(fields.number(1), Err(Malformed::Number { field: 2 }));
}

#[test]
fn times_are_exact_where_binary_numbers_are_not() {
    let form = form(Delimiter::Spaces, 1);
    let whole = |text: &str, unit| form.parse(text.as_bytes()).unwrap().unwrap().whole(0, unit).ok();
    assert_eq!(whole("1700000000.123456789", Unit::NanosecondInSeconds), Some(1_700_000_000_123_456_789));
    assert_eq!(whole("12.34", Unit::NanosecondInSeconds), Some(12_340_000_000));
    assert_eq!(whole("12.3456789", Unit::NanosecondInMicroseconds), Some(12_345));
    assert_eq!(whole(".5", Unit::NanosecondInMilliseconds), Some(500_000));
    assert_eq!(whole("7", Unit::One), Some(7));
    assert_eq!(whole("1.5e3", Unit::NanosecondInSeconds), Some(1_500_000_000_000));
    for wrong in ["-1", "x", ".", "nan", "1e40", "99999999999999999999", "18446744073710"] {
        assert_eq!(whole(wrong, Unit::NanosecondInSeconds), None, "{wrong}");
    }
}

#[test]
fn a_stream_that_is_joined_in_the_middle_loses_its_first_piece_only() {
    let mut got = Vec::new();
    Lines::new(10, true).take(b"34 5\r\n\r\n1 2\r3 4\n5", |line| got.push(line.map(<[u8]>::to_vec)));
    assert_eq!(got, [Ok(b"1 2".to_vec()), Ok(b"3 4".to_vec())]);
}

proptest! {
    #[test]
    fn pieces_make_no_difference(
        bytes in proptest::collection::vec(prop_oneof![3 => 0x30u8..0x33, 1 => Just(b'\n'), 1 => Just(b'\r')], 0..200),
        cuts in proptest::collection::vec(0usize..200, 0..10), longest in 1usize..8, cut: bool,
    ) {
        let collect = |pieces: &[&[u8]]| {
            let mut lines = Lines::new(longest, cut);
            let mut got = Vec::new();
            for piece in pieces {
                lines.take(piece, |line| got.push(line.map(<[u8]>::to_vec)));
                assert!(lines.partial.len() <= longest);
            }
            lines.end(|line| got.push(line.map(<[u8]>::to_vec)));
            got
        };
        let mut cuts: Vec<usize> = cuts.into_iter().map(|cut| cut.min(bytes.len())).chain([0, bytes.len()]).collect();
        cuts.sort_unstable();
        let pieces: Vec<&[u8]> = cuts.windows(2).map(|pair| &bytes[pair[0]..pair[1]]).collect();
        prop_assert_eq!(collect(&pieces), collect(&[&bytes]));
    }

    #[test]
    fn what_is_written_is_read(values in proptest::collection::vec(-1e6..1e6f64, 1..20), comma: bool) {
        let decimal = if comma { Decimal::Comma } else { Decimal::Point };
        let form = LineForm { decimal, ..form(Delimiter::Semicolon, values.len()) };
        let line: Vec<String> = values.iter().map(ToString::to_string).collect();
        let line = line.join(";").replace('.', if comma { "," } else { "." });
        prop_assert_eq!(numbers(&form, &line), Ok(Some(values)));
    }

    #[test]
    fn garbage_never_panics(line in proptest::collection::vec(any::<u8>(), 0..100), fields in 0usize..5) {
        for delimiter in [Delimiter::Spaces, Delimiter::Tab, Delimiter::Comma, Delimiter::Semicolon] {
            for decimal in [Decimal::Point, Decimal::Comma] {
                let form = LineForm { decimal, ..form(delimiter, fields) };
                if let Ok(Some(found)) = form.parse(&line) {
                    let _any = found.whole(0, Unit::NanosecondInSeconds);
                    let _any = found.numbers(&[0, 1, 7], &mut Vec::new());
                }
            }
        }
    }
}
