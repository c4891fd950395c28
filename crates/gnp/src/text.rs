//! Text for people: lines that fit, durations that read well.

use std::time::Duration;

/// Longest line of text.
pub const COLUMNS: usize = 80;

/// Every line that is longer than [`COLUMNS`] broken between words, what follows indented; other lines as they are.
#[must_use]
pub fn fitted(text: &str) -> String {
    let broken = |line: &str| {
        if line.chars().count() <= COLUMNS {
            return line.to_owned();
        }
        let indent = &line[..line.len() - line.trim_start().len()];
        let mut lines = vec![indent.to_owned()];
        // After an indented name and its spaces the gap stays as it is: only words are moved.
        for word in line.trim_start().split(' ') {
            let Some(last) = lines.last_mut() else { break };
            let empty = last.trim().is_empty();
            if empty || last.chars().count() + 1 + word.chars().count() <= COLUMNS {
                last.push_str(if empty { "" } else { " " });
                last.push_str(word);
            } else {
                lines.push(format!("{indent}  {word}"));
            }
        }
        lines.iter().map(|line| line.trim_end()).collect::<Vec<_>>().join("\n")
    };
    text.split('\n').map(broken).collect::<Vec<_>>().join("\n")
}

/// A duration as `1 h 02 min`, `3 min 04 s` or `5.6 s`.
#[must_use]
pub fn duration(time: Duration) -> String {
    let seconds = time.as_secs();
    match seconds {
        0..60 => format!("{:.1} s", time.as_secs_f64()),
        60..3600 => format!("{} min {:02} s", seconds / 60, seconds % 60),
        _ => format!("{} h {:02} min", seconds / 3600, seconds / 60 % 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lines_are_broken_between_words() {
        let text = format!("short   line\n  name     {}", "word ".repeat(50));
        let broken = fitted(&text);
        let lines: Vec<&str> = broken.lines().collect();
        assert!(lines.len() == 5 && lines.iter().all(|line| line.chars().count() <= COLUMNS), "{broken}");
        assert_eq!(lines[0], "short   line");
        assert!(lines[1].starts_with("  name     word") && lines[2].starts_with("    word"), "{broken}");
        assert_eq!(broken.split_whitespace().count(), 53);
        // What cannot be broken stays whole.
        assert_eq!(fitted(&"x".repeat(120)).len(), 120);
    }

    #[test]
    fn durations_read_well() {
        for (millis, text) in [(5_600, "5.6 s"), (184_000, "3 min 04 s"), (3_720_000, "1 h 02 min")] {
            assert_eq!(duration(Duration::from_millis(millis)), text);
        }
    }
}
