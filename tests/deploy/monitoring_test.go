package deploy

import (
	"os"
	"slices"
	"strings"
	"testing"

	autoscalingv2 "k8s.io/api/autoscaling/v2"
	corev1 "k8s.io/api/core/v1"
	metav1 "k8s.io/apimachinery/pkg/apis/meta/v1"
	"k8s.io/apimachinery/pkg/labels"
	"sigs.k8s.io/yaml"
)

func TestWorkersAreScaledByWhatCoordinatorsAskFor(t *testing.T) {
	served := scrape(t)
	found := 0
	eachRelease(t, func(t *testing.T, r *release) {
		worker := r.workload(t, releaseName+"-worker")
		if len(r.scaledObjects) == 0 {
			if worker.replicas == nil {
				t.Error("nobody says how many workers there are")
			}
			return
		}
		found++
		if worker.replicas != nil {
			t.Error("the chart and KEDA both say how many workers there are")
		}
		spec := r.scaledObjects[0].Spec
		if spec.ScaleTargetRef.Name != worker.name || *spec.MinReplicaCount > *spec.MaxReplicaCount {
			t.Errorf("scales %s from %d to %d", spec.ScaleTargetRef.Name, *spec.MinReplicaCount, *spec.MaxReplicaCount)
		}
		trigger := spec.Triggers[0]
		// AverageValue with threshold 1: as many pods as the query says. Fallback needs it too.
		if trigger.Type != "prometheus" || trigger.MetricType != autoscalingv2.AverageValueMetricType || trigger.Metadata["threshold"] != "1" {
			t.Errorf("trigger %+v", trigger)
		}
		query := trigger.Metadata["query"]
		if err := served.check(query); err != nil || !strings.Contains(query, "metrofarm_desired_workers") {
			t.Errorf("%s: %v", query, err)
		}
		if service := r.service(releaseName + "-coordinator"); !strings.Contains(query, `service="`+service.Name+`"`) ||
			!strings.Contains(query, `namespace="`+namespace+`"`) {
			t.Errorf("%s does not keep to this release", query)
		}
	})
	if found == 0 {
		t.Error("no values file scales workers")
	}
}

func TestMonitorsFindWhatServesMetrics(t *testing.T) {
	found := 0
	eachRelease(t, func(t *testing.T, r *release) {
		for _, m := range r.serviceMonitors {
			found++
			r.checkServiceMonitor(t, m)
		}
		for _, m := range r.podMonitors {
			w, one := r.one(t, "monitor "+m.Name, &m.Spec.Selector)
			for _, e := range m.Spec.PodMetricsEndpoints {
				if one && !w.hasPort(e.Port) {
					t.Errorf("monitor %s scrapes port %s", m.Name, e.Port)
				}
			}
		}
	})
	if found == 0 {
		t.Error("no values file has monitors")
	}
}

func (r *release) checkServiceMonitor(t *testing.T, m *serviceMonitor) {
	t.Helper()
	selector, err := metav1.LabelSelectorAsSelector(&m.Spec.Selector)
	if err != nil {
		t.Fatal(err)
	}
	matched := 0
	for _, s := range r.services {
		if !selector.Matches(labels.Set(s.Labels)) {
			continue
		}
		matched++
		if s.Spec.ClusterIP != "None" {
			t.Errorf("monitor %s scrapes service %s, behind which it cannot tell coordinators apart", m.Name, s.Name)
		}
		for _, e := range m.Spec.Endpoints {
			if !servicePort(s.Spec.Ports, e.Port) {
				t.Errorf("monitor %s scrapes port %s of %s", m.Name, e.Port, s.Name)
			}
			if e.Authorization == nil || e.Authorization.Credentials.Key == "" {
				t.Errorf("monitor %s has no token", m.Name)
			}
		}
	}
	if matched != 1 {
		t.Errorf("monitor %s finds %d services; scraped twice, sums are twice as large", m.Name, matched)
	}
}

func servicePort(ports []corev1.ServicePort, name string) bool {
	return slices.ContainsFunc(ports, func(p corev1.ServicePort) bool { return p.Name == name })
}

// The operator's rules are the files' rules.
func TestTheChartHasTheSameRules(t *testing.T) {
	want := 0
	for _, file := range ruleFiles {
		content, err := os.ReadFile(file)
		if err != nil {
			t.Fatal(err)
		}
		var rules prometheusRule
		if err := yaml.Unmarshal(content, &rules.Spec); err != nil {
			t.Fatal(err)
		}
		for _, group := range rules.Spec.Groups {
			want += len(group.Rules)
		}
	}
	found := 0
	eachRelease(t, func(t *testing.T, r *release) {
		for _, rules := range r.rules {
			got := 0
			for _, group := range rules.Spec.Groups {
				got += len(group.Rules)
			}
			if found++; got != want {
				t.Errorf("%d rules; the files have %d", got, want)
			}
		}
	})
	if found == 0 {
		t.Error("no values file has rules")
	}
}
