//! Lines of text, as home-made plates, microcontrollers and other programs send them.

/// Format of the lines.
#[derive(Debug, Clone, PartialEq)]
pub struct Style {
    /// Between the fields.
    pub delimiter: char,
    /// The decimal sign.
    pub decimal: char,
    /// Before the first field, for example `F:`.
    pub prefix: String,
    /// `\n` or `\r\n`; empty where every line is a datagram.
    pub end: String,
    /// Decimals of every number.
    pub decimals: usize,
}

impl Default for Style {
    /// Comma, point, `\n`.
    fn default() -> Style {
        Style { delimiter: ',', decimal: '.', prefix: String::new(), end: "\n".into(), decimals: 6 }
    }
}

impl Style {
    /// A line: its number, and then the fields.
    pub fn line(&self, number: u32, fields: &[f64]) -> String {
        let decimals = self.decimals;
        let written =
            fields.iter().map(|field| format!("{field:.decimals$}").replace('.', &self.decimal.to_string()));
        let fields: Vec<String> = [number.to_string()].into_iter().chain(written).collect();
        format!("{}{}{}", self.prefix, fields.join(&self.delimiter.to_string()), self.end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_written_as_the_style_says() {
        assert_eq!(Style::default().line(7, &[1.5, -2.0]), "7,1.500000,-2.000000\n");
        let style =
            Style { delimiter: ';', decimal: ',', prefix: "F:".into(), end: "\r\n".into(), decimals: 2 };
        assert_eq!(style.line(0, &[0.125, 700.0]), "F:0;0,12;700,00\r\n");
    }
}
