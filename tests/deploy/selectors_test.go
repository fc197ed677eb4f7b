package deploy

import (
	"testing"

	corev1 "k8s.io/api/core/v1"
	networkingv1 "k8s.io/api/networking/v1"
	metav1 "k8s.io/apimachinery/pkg/apis/meta/v1"
	"k8s.io/apimachinery/pkg/labels"
	"k8s.io/apimachinery/pkg/util/intstr"
)

// selected lists the workloads whose pods a selector matches.
func (r *release) selected(t *testing.T, selector *metav1.LabelSelector) []workload {
	t.Helper()
	s, err := metav1.LabelSelectorAsSelector(selector)
	if err != nil {
		t.Fatal(err)
	}
	var all []workload
	for _, w := range r.workloads() {
		if s.Matches(labels.Set(w.template.Labels)) {
			all = append(all, w)
		}
	}
	return all
}

// one wants a selector to match the pods of exactly one workload.
func (r *release) one(t *testing.T, who string, selector *metav1.LabelSelector) (workload, bool) {
	t.Helper()
	all := r.selected(t, selector)
	if len(all) != 1 {
		t.Errorf("%s selects the pods of %d workloads; want 1", who, len(all))
		return workload{}, false
	}
	return all[0], true
}

func TestSelectorsMatchOneWorkload(t *testing.T) {
	eachRelease(t, func(t *testing.T, r *release) {
		for _, w := range r.workloads() {
			if chosen, found := r.one(t, w.name, w.selector); found && chosen.name != w.name {
				t.Errorf("%s selects the pods of %s", w.name, chosen.name)
			}
		}
		for _, b := range r.budgets {
			r.one(t, "budget "+b.Name, b.Spec.Selector)
		}
		for _, s := range r.services {
			w, found := r.one(t, "service "+s.Name, &metav1.LabelSelector{MatchLabels: s.Spec.Selector})
			for _, p := range s.Spec.Ports {
				if found && !w.hasPort(p.TargetPort.StrVal) {
					t.Errorf("service %s leads to port %s, which %s has not", s.Name, p.TargetPort.String(), w.name)
				}
			}
		}
		for _, s := range r.statefulSets {
			if service := r.service(s.Spec.ServiceName); service == nil {
				t.Errorf("%s has no service %s", s.Name, s.Spec.ServiceName)
			}
		}
	})
}

func (r *release) service(name string) *corev1.Service {
	for _, s := range r.services {
		if s.Name == name {
			return s
		}
	}
	return nil
}

func TestWhatIsNamedExists(t *testing.T) {
	eachRelease(t, func(t *testing.T, r *release) {
		accounts, claims := map[string]bool{}, map[string]bool{"renders": true} // of values/small.yaml
		for _, a := range r.accounts {
			accounts[a.Name] = true
		}
		for _, c := range r.claims {
			claims[c.Name] = true
		}
		for _, w := range r.workloads() {
			if !accounts[w.template.Spec.ServiceAccountName] {
				t.Errorf("%s runs as %s, which does not exist", w.name, w.template.Spec.ServiceAccountName)
			}
			for _, v := range w.template.Spec.Volumes {
				if c := v.PersistentVolumeClaim; c != nil && c.ClaimName != "" && !claims[c.ClaimName] {
					t.Errorf("%s mounts claim %s, which does not exist", w.name, c.ClaimName)
				}
			}
		}
		for _, i := range r.ingresses {
			backend := i.Spec.Rules[0].HTTP.Paths[0].Backend.Service
			if s := r.service(backend.Name); s == nil || s.Spec.Ports[0].Name != backend.Port.Name {
				t.Errorf("the ingress leads to %s %s", backend.Name, backend.Port.Name)
			}
		}
	})
}

func TestPoliciesLetThroughWhatIsNeeded(t *testing.T) {
	eachRelease(t, func(t *testing.T, r *release) {
		if len(r.policies) == 0 {
			return
		}
		covered := map[string]bool{}
		for _, p := range r.policies {
			w, found := r.one(t, "policy "+p.Name, &p.Spec.PodSelector)
			if !found {
				continue
			}
			covered[w.name] = true
			if len(p.Spec.PolicyTypes) != 2 {
				t.Errorf("policy %s leaves a direction open: %v", p.Name, p.Spec.PolicyTypes)
			}
			for _, rule := range p.Spec.Ingress {
				r.checkPorts(t, p.Name, rule.Ports, []workload{w})
			}
			for _, rule := range p.Spec.Egress {
				r.checkPorts(t, p.Name, rule.Ports, r.peers(t, p.Name, rule.To))
			}
		}
		for _, w := range r.workloads() {
			if !covered[w.name] {
				t.Errorf("no policy covers %s", w.name)
			}
		}
		r.checkFlow(t, releaseName+"-worker", releaseName+"-coordinator", "farm", true)
		r.checkFlow(t, releaseName+"-coordinator", releaseName+"-coordinator", "rest", true)
		r.checkFlow(t, releaseName+"-worker", releaseName+"-coordinator", "rest", false)
	})
}

// peers are the workloads of the release that a policy names.
func (r *release) peers(t *testing.T, who string, named []networkingv1.NetworkPolicyPeer) []workload {
	t.Helper()
	var all []workload
	for _, peer := range named {
		if peer.PodSelector == nil || peer.NamespaceSelector != nil {
			continue
		}
		if w, found := r.one(t, "policy "+who, peer.PodSelector); found {
			all = append(all, w)
		}
	}
	return all
}

// checkPorts wants ports that are named to exist where they lead.
func (r *release) checkPorts(t *testing.T, who string, ports []networkingv1.NetworkPolicyPort, at []workload) {
	t.Helper()
	for _, p := range ports {
		if p.Port.Type != intstr.String {
			continue
		}
		for _, w := range at {
			if !w.hasPort(p.Port.StrVal) {
				t.Errorf("policy %s names port %s, which %s has not", who, p.Port.StrVal, w.name)
			}
		}
		if len(at) == 0 {
			t.Errorf("policy %s names port %s of nobody", who, p.Port.StrVal)
		}
	}
}

// checkFlow wants the policies of both ends to let a connection through, or one of them not to. Only
// peers that are named by their pods count: values can add others.
func (r *release) checkFlow(t *testing.T, from, to, port string, wanted bool) {
	t.Helper()
	out, in := false, false
	for _, p := range r.policies {
		for _, rule := range p.Spec.Egress {
			for _, w := range r.peers(t, p.Name, rule.To) {
				out = out || p.Name == from && w.name == to && opens(rule.Ports, port)
			}
		}
		for _, rule := range p.Spec.Ingress {
			for _, w := range r.peers(t, p.Name, rule.From) {
				in = in || p.Name == to && w.name == from && opens(rule.Ports, port)
			}
		}
	}
	if (out && in) != wanted {
		t.Errorf("%s to port %s of %s: out %v, in %v; wanted %v", from, port, to, out, in, wanted)
	}
}

func opens(ports []networkingv1.NetworkPolicyPort, name string) bool {
	for _, p := range ports {
		if p.Port.StrVal == name {
			return true
		}
	}
	return false
}
