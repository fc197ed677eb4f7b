package deploy

import (
	"encoding/json"
	"errors"
	"fmt"
	"io"
	"log/slog"
	"maps"
	"os"
	"os/exec"
	"slices"
	"strings"
	"testing"

	"github.com/prometheus/common/model"
	labelsp "github.com/prometheus/prometheus/model/labels"
	"github.com/prometheus/prometheus/model/rulefmt"
	"github.com/prometheus/prometheus/promql/parser"
)

const dashboard = "../../deploy/grafana/dashboards/metrofarm.json"

var ruleFiles = []string{"../../deploy/prometheus/recording.rules.yml", "../../deploy/prometheus/alerts.rules.yml"}

// scrapeLabels are put on by Prometheus; any value may be.
var scrapeLabels = []string{"job", "instance", "namespace", "service", "pod"}

// openLabels have values that no fresh coordinator shows.
var openLabels = []string{"code", "route", "method", "grpc_code"}

// check wants a query to parse and to name only metrics, labels and values that are served.
func (m metrics) check(query string) error {
	expression, err := parser.NewParser(parser.Options{}).ParseExpr(query)
	if err != nil {
		return err
	}
	var faults []error
	parser.Inspect(expression, func(node parser.Node, _ []parser.Node) error {
		switch n := node.(type) {
		case *parser.VectorSelector:
			faults = append(faults, m.checkSelector(n))
		case *parser.AggregateExpr:
			faults = append(faults, m.checkGrouping(n))
		}
		return nil
	})
	return errors.Join(faults...)
}

func (m metrics) checkSelector(s *parser.VectorSelector) error {
	if s.Name == "up" || s.Name == "ALERTS" { // Prometheus makes them
		return nil
	}
	labels, served := m[s.Name]
	if !served {
		return fmt.Errorf("nobody serves %s", s.Name)
	}
	for _, matcher := range s.LabelMatchers {
		if matcher.Name == labelsp.MetricName || slices.Contains(scrapeLabels, matcher.Name) {
			continue
		}
		values := labels[matcher.Name]
		if len(values) == 0 {
			return fmt.Errorf("%s has no label %s", s.Name, matcher.Name)
		}
		if slices.Contains(openLabels, matcher.Name) {
			continue
		}
		positive, err := labelsp.NewMatcher(positiveType(matcher.Type), matcher.Name, matcher.Value)
		if err != nil {
			return err
		}
		if !slices.ContainsFunc(slices.Collect(maps.Keys(values)), positive.Matches) {
			return fmt.Errorf("%s: no %s is %s", s.Name, matcher.Name, matcher.Value)
		}
	}
	return nil
}

func positiveType(t labelsp.MatchType) labelsp.MatchType {
	switch t {
	case labelsp.MatchNotEqual:
		return labelsp.MatchEqual
	case labelsp.MatchNotRegexp:
		return labelsp.MatchRegexp
	}
	return t
}

// checkGrouping wants the labels that results are grouped by to be on what is aggregated.
func (m metrics) checkGrouping(a *parser.AggregateExpr) error {
	known := map[string]bool{}
	for label := range m.labelsOf(a.Expr) {
		known[label] = true
	}
	for _, label := range a.Grouping {
		if !known[label] && !slices.Contains(scrapeLabels, label) {
			return fmt.Errorf("%s groups by %s, which nothing in it has", a, label)
		}
	}
	return nil
}

// labelsOf are the labels of what a part of a query reads, with the values seen.
func (m metrics) labelsOf(node parser.Node) map[string]map[string]bool {
	all := map[string]map[string]bool{}
	parser.Inspect(node, func(n parser.Node, _ []parser.Node) error {
		if s, is := n.(*parser.VectorSelector); is {
			maps.Copy(all, m[s.Name])
		}
		return nil
	})
	return all
}

// withRules adds what the recording rules make.
func (m metrics) withRules(t *testing.T) metrics {
	t.Helper()
	all := maps.Clone(m)
	for _, group := range parseRules(t, ruleFiles[0]).Groups {
		for _, rule := range group.Rules {
			expression, err := parser.NewParser(parser.Options{}).ParseExpr(rule.Expr)
			if err != nil {
				t.Fatal(err)
			}
			all[rule.Record] = m.labelsOf(expression)
		}
	}
	return all
}

func parseRules(t *testing.T, file string) *rulefmt.RuleGroups {
	t.Helper()
	rules, faults := rulefmt.ParseFile(file, false, model.LegacyValidation, parser.NewParser(parser.Options{}),
		slog.New(slog.NewTextHandler(io.Discard, nil)))
	if len(faults) > 0 {
		t.Fatal(errors.Join(faults...))
	}
	return rules
}

func TestRulesNameWhatIsServed(t *testing.T) {
	served := scrape(t).withRules(t)
	for _, file := range ruleFiles {
		for _, group := range parseRules(t, file).Groups {
			for _, rule := range group.Rules {
				if err := served.check(rule.Expr); err != nil {
					t.Errorf("%s%s: %v", rule.Record, rule.Alert, err)
				}
				if rule.Alert != "" && (rule.Labels["severity"] == "" || rule.Annotations["summary"] == "" || rule.Annotations["description"] == "") {
					t.Errorf("%s lacks severity, summary or description", rule.Alert)
				}
			}
		}
	}
}

func TestDashboardNamesWhatIsServed(t *testing.T) {
	content, err := os.ReadFile(dashboard)
	if err != nil {
		t.Fatal(err)
	}
	type target struct {
		Expr string `json:"expr"`
	}
	var board struct {
		Panels []struct {
			ID      int      `json:"id"`
			Type    string   `json:"type"`
			Title   string   `json:"title"`
			Targets []target `json:"targets"`
		} `json:"panels"`
		Annotations struct {
			List []target `json:"list"`
		} `json:"annotations"`
	}
	if err := json.Unmarshal(content, &board); err != nil {
		t.Fatal(err)
	}
	served, seen := scrape(t).withRules(t), map[int]bool{}
	queries := map[string]string{}
	for _, panel := range board.Panels {
		if seen[panel.ID] || panel.Type != "row" && len(panel.Targets) == 0 {
			t.Errorf("panel %d %q: its id is not its own, or it asks nothing", panel.ID, panel.Title)
		}
		seen[panel.ID] = true
		for _, target := range panel.Targets {
			queries[target.Expr] = panel.Title
		}
	}
	for _, target := range board.Annotations.List {
		queries[target.Expr] = "annotation"
	}
	if len(queries) < 40 {
		t.Errorf("only %d queries were found", len(queries))
	}
	for query, title := range queries {
		if err := served.check(strings.ReplaceAll(query, "$__rate_interval", "1m")); err != nil {
			t.Errorf("%q: %v", title, err)
		}
	}
}

// A check that lets everything through would be worthless.
func TestWrongQueriesAreFound(t *testing.T) {
	served := scrape(t).withRules(t)
	for _, query := range []string{
		"metrofarm_job_count", `metrofarm_jobs{status="done"}`, `metrofarm_jobs{state="finished"}`,
		`metrofarm_jobs{state!="finished"}`, `metrofarm_jobs{state=~"finished|ended"}`, "sum by (outcome) (metrofarm_jobs)",
		"sum(metrofarm_jobs", "metrofarm:workers", `rate(metrofarm_segments_total)`,
	} {
		if served.check(query) == nil {
			t.Errorf("%s passed", query)
		}
	}
}

// Names follow Prometheus' conventions: the prefix, base units, _total on counters.
func TestMetricsAreNamedWell(t *testing.T) {
	for name := range scrape(t) {
		foreign := strings.HasPrefix(name, "go_") || strings.HasPrefix(name, "process_") ||
			strings.HasPrefix(name, "grpc_server_") || strings.HasPrefix(name, "promhttp_")
		if foreign {
			continue
		}
		if !strings.HasPrefix(name, "metrofarm_") {
			t.Errorf("%s lacks the prefix", name)
		}
		for _, unit := range []string{"_ms_", "_milliseconds_", "_minutes_", "_kb_", "_mb_", "_percent_"} {
			if strings.Contains(name+"_", unit) {
				t.Errorf("%s is not in a base unit", name)
			}
		}
	}
}

// promtool, where it is installed, checks what we use of Prometheus by its own means, with the rules
// at work on made-up series.
func TestPromtoolAgrees(t *testing.T) {
	promtool, err := exec.LookPath("promtool")
	if err != nil {
		t.Skip("promtool is not installed (Debian package prometheus)")
	}
	for _, arguments := range [][]string{
		append([]string{"check", "rules"}, ruleFiles...),
		{"check", "config", "--syntax-only", "../../deploy/prometheus/prometheus.yml"},
		{"test", "rules", "alerts_test.yml"},
	} {
		if output, err := exec.Command(promtool, arguments...).CombinedOutput(); err != nil {
			t.Errorf("promtool %s: %v\n%s", strings.Join(arguments, " "), err, output)
		}
	}
}
