// Package deploy checks what deploy/ holds without a cluster: the chart's manifests are what
// Kubernetes takes and fit together, and queries name metrics that the programs serve.
//
// It is a module of its own, so that helm's dependencies stay out of the services'.
package deploy

import (
	"os"
	"path/filepath"
	"sort"
	"strings"
	"testing"

	"helm.sh/helm/v4/pkg/chart/common"
	"helm.sh/helm/v4/pkg/chart/common/util"
	"helm.sh/helm/v4/pkg/chart/v2/loader"
	"helm.sh/helm/v4/pkg/engine"
	"sigs.k8s.io/yaml"
)

const (
	chartDir    = "../../deploy/helm/metrofarm"
	releaseName = "farm"
	namespace   = "rendering"
)

// render returns the chart's manifests, one document each, in a stable order.
func render(values map[string]any) ([]string, error) {
	chart, err := loader.Load(chartDir)
	if err != nil {
		return nil, err
	}
	options := common.ReleaseOptions{Name: releaseName, Namespace: namespace, Revision: 1, IsInstall: true}
	all, err := util.ToRenderValues(chart, values, options, nil)
	if err != nil {
		return nil, err
	}
	files, err := engine.Render(chart, all)
	if err != nil {
		return nil, err
	}
	var documents []string
	for name, content := range files {
		if filepath.Ext(name) != ".yaml" {
			continue
		}
		for document := range strings.SplitSeq(content, "\n---") {
			if hasContent(document) {
				documents = append(documents, document)
			}
		}
	}
	sort.Strings(documents)
	return documents, nil
}

func hasContent(document string) bool {
	for line := range strings.SplitSeq(document, "\n") {
		if line = strings.TrimSpace(line); line != "" && line != "---" && !strings.HasPrefix(line, "#") {
			return true
		}
	}
	return false
}

// valuesFiles are the settings that the chart is rendered with, beside its defaults.
func valuesFiles(t *testing.T) map[string]map[string]any {
	t.Helper()
	files, err := filepath.Glob("values/*.yaml")
	if err != nil || len(files) < 3 {
		t.Fatalf("values: %v, %v", files, err)
	}
	all := map[string]map[string]any{"default": {}}
	for _, file := range files {
		content, err := os.ReadFile(file)
		if err != nil {
			t.Fatal(err)
		}
		values := map[string]any{}
		if err := yaml.UnmarshalStrict(content, &values); err != nil {
			t.Fatalf("%s: %v", file, err)
		}
		all[strings.TrimSuffix(filepath.Base(file), ".yaml")] = values
	}
	return all
}

// eachRelease runs a test for every set of values.
func eachRelease(t *testing.T, test func(t *testing.T, r *release)) {
	t.Helper()
	for name, values := range valuesFiles(t) {
		t.Run(name, func(t *testing.T) {
			documents, err := render(values)
			if err != nil {
				t.Fatal(err)
			}
			r := &release{}
			for _, document := range documents {
				if err := r.add(document); err != nil {
					t.Errorf("%v in\n%s", err, document)
				}
			}
			test(t, r)
		})
	}
}

func TestValuesThatMakeNoSenseAreRefused(t *testing.T) {
	for name, c := range map[string]struct{ values, complaint string }{
		"no coordinator":     {"coordinator: {replicas: 0}", "replicas"},
		"no time":            {"coordinator: {keepJobs: month}", "keepJobs"},
		"misspelt":           {"coordinator: {replica: 2}", "replica"},
		"not a share":        {"worker: {maxUnavailable: some}", "maxUnavailable"},
		"not a bucket":       {"blobs: {s3: {location: /srv/blobs}}", "location"},
		"empty secret":       {"secrets: {access: ''}", "access"},
		"no Redis":           {"redis: {enabled: false}", "redis.url"},
		"blobs not shared":   {"blobs: {volume: {accessMode: ReadWriteOnce}}", "ReadWriteMany"},
		"unsatisfiable":      {"coordinator: {minAvailable: 3}", "minAvailable"},
		"not an address":     {"redis: {enabled: false, url: 'redis.example.com'}", "url"},
		"unknown pull rule":  {"image: {pullPolicy: Sometimes}", "pullPolicy"},
		"fraction of a core": {"worker: {threads: 0.5}", "threads"},
	} {
		t.Run(name, func(t *testing.T) {
			values := map[string]any{}
			if err := yaml.Unmarshal([]byte(c.values), &values); err != nil {
				t.Fatal(err)
			}
			_, err := render(values)
			if err == nil || !strings.Contains(err.Error(), c.complaint) {
				t.Errorf("%s: error %v; want one that names %s", c.values, err, c.complaint)
			}
		})
	}
}
